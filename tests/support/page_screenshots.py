"""Takes pictures of the page for the docs: `python3 -m support.page_screenshots FOLDER`, in Debian's chromium.

`browser_new_job`, `browser_cameras` and `browser_approval` are of a stand-in cell, `browser_history` and
`browser_no_data` of real nodes.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rospy
from playwright.sync_api import expect, sync_playwright

from skiros2_skill.client.description import Step
from skiros2_skill.client.manager import ManagerClient
from support.job_cell import ROBOT, TOKENS, JobCell, job_cell
from support.ros import INSTALL, ROOT, RosMaster, wait_until
from support.served_page import served_page

#: The time until an animation or a drawing has settled (ms).
_SETTLING = 1000
_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]


def main(folder: Path) -> None:
    """Writes the pictures into a folder."""
    with sync_playwright() as started, tempfile.TemporaryDirectory() as scratch:
        browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=_ARGUMENTS)
        with served_page(Path(scratch), INSTALL / "share/skiros2_gateway/page") as address:
            _new_job(_opened(browser, address, "operate"), folder / "browser_new_job.png")
            _cameras(_opened(browser, address, "view"), folder / "browser_cameras.png")
            _approval(_opened(browser, address, "approve"), folder / "browser_approval.png")
        with _cell(Path(scratch)) as cell:
            _history(_opened(browser, cell.rest.address, "operate"), folder / "browser_history.png")
            _no_data(_opened(browser, cell.rest.address, "operate"), cell, folder / "browser_no_data.png")
        browser.close()


@contextmanager
def _cell(folder: Path) -> Iterator[JobCell]:
    folder, bags = folder / "cell", folder / "cell/recorded"
    bags.mkdir(parents=True)
    for file in sorted((ROOT / "tests/bags").glob("*.bag")):
        shutil.copy2(file, bags)
    with RosMaster(folder) as master:
        os.environ.update({key: master.env[key] for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_HOME")})
        rospy.init_node("tests", disable_signals=True)
        with job_cell(master, folder, agents="ask", bags=str(bags)) as cell:
            yield cell
        rospy.signal_shutdown("the pictures are taken")


def _opened(browser: Any, address: str, user: str) -> Any:
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.set_default_timeout(60_000)
    expect.set_options(timeout=60_000)
    page.goto(address)
    page.fill("#token", TOKENS[user])
    page.click("#login")
    return page


def _save(page: Any, path: Path) -> None:
    page.wait_for_timeout(_SETTLING)
    page.screenshot(path=str(path))
    sys.stdout.write(f"{path}\n")
    page.context.close()


def _new_job(page: Any, path: Path) -> None:
    page.click("#new-job")
    page.click("dialog.job summary")
    page.fill("dialog.job [name=priority]", "7")
    page.fill("dialog.job [name=due]", "2030-01-01T10:00")
    page.fill("dialog.job [name=earliest_start]", "2031-01-01T10:00")
    page.click("#start-job")
    expect(page.locator("#problems-due")).not_to_be_empty()
    _save(page, path)


def _cameras(page: Any, path: Path) -> None:
    page.click("nav[data-region=right] >> text=Cameras")
    expect(page.get_by_text("no node publishes")).to_be_visible()
    _save(page, path)


def _approval(page: Any, path: Path) -> None:
    page.click("#approvals")
    expect(page.locator("[data-action=approve]")).to_be_visible()
    _save(page, path)


def _history(page: Any, path: Path) -> None:
    page.get_by_text("Recorded runs").click()
    page.get_by_text("contact.bag").click()
    page.get_by_text("insert_into_bore").first.click()
    page.click("nav[data-region=centre] >> text=Signals")
    slider = page.locator("input[type=range]")
    slider.evaluate("(each) => { each.value = (+each.min + +each.max) / 2; each.dispatchEvent(new Event('input')); }")
    page.locator('[data-panel="scene"][data-loading="0"] canvas').wait_for()
    page.wait_for_timeout(5 * _SETTLING)
    _save(page, path)


def _no_data(page: Any, cell: JobCell, path: Path) -> None:
    for number in range(2):
        assert cell.rest.post("/api/jobs", cell.order(f"order-{number}", number))[0] == 201
    cell.wait_for(["order-0", "order-1"])
    robot = ManagerClient(ROBOT, "tests")
    skill = next(skill for skill in robot.read_skills() if skill.label == "wait_for_stop")
    robot.command("start", -1, [Step(skill.type, skill.label)])
    wait_until(robot.read_tasks, what="a task")
    page.get_by_text("wait_for_stop").last.click()
    gateway = cell.ros.master.node_pid("/gateway")
    os.kill(gateway, signal.SIGSTOP)
    try:
        expect(page.locator("#connection")).to_have_text(re.compile(r"no data for \d+ s"))
        _save(page, path)
    finally:
        os.kill(gateway, signal.SIGCONT)
    robot.command("preempt", -1)
    robot.close()


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
