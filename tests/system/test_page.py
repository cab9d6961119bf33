"""The gateway's page in Debian's chromium, on a cell of real nodes."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from skiros2_skill.client.description import Step
from skiros2_skill.client.manager import ManagerClient
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.agent import connected_agent
from support.forwarder import Forwarder
from support.job_cell import ROBOT, TOKENS, JobCell
from support.programs import PATIENCE
from support.ros import INSTALL, ROOT, Ros, RosMaster, wait_until

playwright = pytest.importorskip("playwright.sync_api", reason="needs requirements/browser.txt")

CHROMIUM = shutil.which("chromium")
BAGS = ROOT / "tests/bags"
PAGE = INSTALL / "share/skiros2_gateway/page/index.html"

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium"),
    pytest.mark.skipif(not PAGE.is_file(), reason="the page is not built: npm had no network at the set-up"),
]


@pytest.fixture(scope="module")
def cell(ros_master: RosMaster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[JobCell]:
    ros = Ros(ros_master)
    try:
        cell = JobCell(ros, tmp_path_factory.mktemp("page"), agents="ask", bags=str(BAGS))
        _wait_until_connected(cell)
        yield cell
    finally:
        ros.stop()


def _wait_until_connected(cell: JobCell) -> None:
    """Waits until the gateway receives what the page shows of a job: a job that takes no time is over sooner."""
    for node, topic in ((ROBOT, f"{ROBOT}/monitor"), ("/tm", "/tm/achieve/feedback")):
        wait_until(lambda n=node, t=topic: ("/gateway", t) in cell.ros.master.readers(n), what=f"a reader of {topic}")


@pytest.fixture(scope="module")
def forwarder(cell: JobCell) -> Iterator[Forwarder]:
    """Keeps the page's address when the gateway is started again on another port."""
    with Forwarder(_port(cell)) as forwarder:
        yield forwarder


def _port(cell: JobCell) -> int:
    return int(cell.rest.address.rpartition(":")[2])


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    with playwright.sync_playwright() as started:
        playwright.expect.set_options(timeout=1000 * PATIENCE)
        browser = started.chromium.launch(executable_path=CHROMIUM, args=arguments, timeout=1000 * PATIENCE)
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Any, forwarder: Forwarder) -> Iterator[Any]:
    """The page without a user."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(1000 * PATIENCE)
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(f"http://127.0.0.1:{forwarder.port}/")
    yield page
    context.close()
    assert errors == []


def _log_in(page: Any, token: str) -> None:
    page.fill("#token", token)
    page.click("#login")


def _start_job(page: Any, cell: JobCell, product: int) -> None:
    page.click("#new-job")
    page.select_option("select[name=Product]", cell.products[product])
    page.select_option("select[name=Place]", cell.stores[0])
    page.click("#start-job")


def test_job_is_started_by_clicks_and_shown_also_after_a_restart(
    page: Any, cell: JobCell, forwarder: Forwarder, tmp_path: Path
) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    connection, jobs = page.locator("#connection"), page.locator(".left .list").nth(1).locator(".chip")
    elements = page.locator('[data-panel="world"] .tools .dim')
    expect(connection).to_have_text("live")
    expect(page.locator("#stop-all")).to_be_visible()

    _start_job(page, cell, 0)
    expect(jobs).to_have_text(["succeeded"])
    expect(page.locator(".tree .row.success .name", has_text="carry_at_once")).to_be_visible()
    goal = f"{_shown(cell.stores[0])} contains {_shown(cell.products[0])}"
    expect(page.locator(".tree .row:not([hidden]) .name")).to_have_text([goal, "carry_at_once"])
    expect(page.locator(".left .list").nth(2).locator(".title2")).to_have_text([goal])
    page.locator(".tree .row .name", has_text="carry_at_once").click()
    expect(page.locator("[data-panel=tree] .details h2")).to_have_text("carry_at_once")
    page.screenshot(path=str(tmp_path / "goal_tree.png"))
    page.click("nav[data-region=right] >> text=World")
    page.locator("#run-bar input").fill("0")  # the beginning of the run
    expect(elements).to_have_text(re.compile(r"elements at \d"))
    page.click("#run-bar >> text=To the end")
    expect(elements).to_have_text(re.compile("elements$"))
    page.click("nav[data-region=centre] >> text=Plan")
    expect(page.locator(".gantt .step.success .actual")).to_be_visible()

    cell.kill("/gateway")
    expect(connection).to_have_text(re.compile("reconnecting"))
    forwarder.target = _port(cell)
    expect(connection).to_have_text("live")
    cell.wait_until_ready()
    _start_job(page, cell, 1)
    expect(jobs).to_have_text(["succeeded", "succeeded"])
    assert sum(cell.carried().values()) == 2


def _shown(eid: str) -> str:
    """The text of an element without label."""
    return eid.rpartition(":")[2]


def _choose(page: Any, row: int, **boxes: str) -> None:
    """Chooses entries in the lists of a goal's row, by their texts."""
    for box, text in boxes.items():
        with page.expect_response("**/api/goal/form"):
            page.locator(".goal-row").nth(row).locator(f"[data-box={box}]").select_option(label=text)


def test_goal_is_built_from_lists_and_reached(page: Any, cell: JobCell, tmp_path: Path) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    page.click("#new-job")
    page.select_option("#work-master", "")
    expect(page.locator("#make-plan")).to_be_disabled()
    store, product = _shown(cell.stores[1]), _shown(cell.products[2])
    _choose(page, 0, subject=store, predicate="contains", object=product)
    expect(page.locator(".sentence")).to_have_text(f"{store} contains {product}")
    expect(page.locator("textarea[name=goal]")).to_have_value(f"(skiros:contain {cell.stores[1]} {cell.products[2]})")

    page.click("#add-condition")
    _choose(page, 1, subject=product, predicate="Missing")
    value = page.locator(".goal-row").nth(1).locator("[data-box=value]")
    expect(value.locator("option")).to_have_text(["value", "true", "false"])
    _choose(page, 1, predicate="Weight")
    page.locator(".goal-row").nth(1).locator("input[data-box=value]").fill("-1")
    expect(page.locator("#goal-problem")).to_have_text("Weight: expected at least 0 kg, got -1")
    expect(page.locator("#start-job")).to_be_disabled()
    page.screenshot(path=str(tmp_path / "goal.png"))
    page.locator(".goal-row").nth(1).get_by_role("button").click()
    expect(page.locator("#goal-problem")).to_have_text("")

    page.click("#make-plan")
    expect(page.locator(".preview li")).to_contain_text(["carry_at_once"])
    expect(page.locator(".preview")).not_to_contain_text("null")
    page.screenshot(path=str(tmp_path / "plan.png"))
    carried = sum(cell.carried().values())
    page.click("#start-job")
    wait_until(lambda: sum(cell.carried().values()) == carried + 1, what="the end of the job")


def test_goal_as_text_fills_the_rows(page: Any, cell: JobCell) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    page.click("#new-job")
    page.select_option("#work-master", "")
    page.fill("textarea[name=goal]", f"(not (skiros:contain {cell.stores[0]} {cell.products[0]}")
    expect(page.locator("#goal-problem")).to_contain_text("expected")
    page.locator("textarea[name=goal]").press_sequentially("))")
    expect(page.locator("#goal-problem")).to_have_text("")
    expect(page.locator(".goal-row [data-box=object] option:checked")).to_have_text(_shown(cell.products[0]))
    expect(page.locator(".goal-row input[type=checkbox]")).to_be_checked()


def test_bag_shows_one_tree_of_a_goal_and_its_steps(page: Any, tmp_path: Path) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["view"])
    page.click("summary >> text=Recorded runs")
    page.locator(".left .list").nth(3).locator(".title2", has_text="timed_goal.bag").click()
    expect(page.locator(".left .list").nth(2).locator(".title2")).to_have_text(["Tray B contains Product A"])
    page.click("#run-bar >> text=To the end")
    rows = page.locator(".tree .row:not([hidden])")
    for name in ("Tray B contains Product A", "drive", "pick", "place"):
        expect(rows.filter(has_text=name).first).to_have_class(re.compile("success"))
    page.screenshot(path=str(tmp_path / "bag.png"))


def _tool(cell: JobCell, name: str, arguments: dict[str, Any]) -> Future[Any]:
    """Calls an agent's tool in a thread of its own."""

    async def call() -> Any:
        async with connected_agent(cell) as tool:
            return await tool(name, **arguments)

    pool = ThreadPoolExecutor(1)
    future = pool.submit(asyncio.run, call())
    pool.shutdown(wait=False)
    return future


def _wait_for_approvals(cell: JobCell, number: int) -> None:
    wait_until(lambda: len(cell.rest.get("/api/approvals")["approvals"]) == number, what=f"{number} approvals")


def test_person_reads_and_approves_the_plan_that_then_runs(page: Any, cell: JobCell) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["approve"])
    order = {**cell.order("asked", 2), "reason": "the store runs out of it"}
    execution = _tool(cell, "execute", order)
    page.click("#approvals")
    asked = page.get_by_label("Waiting approvals").locator(".approval")
    for text in ("carry_at_once", "the store runs out of it", ROBOT[1:], "agent", "no longer contains"):
        expect(asked).to_contain_text(text)
    page.click("[data-action=approve]")
    expect(asked).to_have_count(0)
    expect(page.locator("#approvals")).to_be_hidden()
    assert execution.result(60.0)["job"] == "asked"
    response = cell.wait_for(["asked"])["asked"]["response"]
    assert response["outcome"] == "succeeded"


def test_approved_plan_that_does_not_work_any_more_is_refused_with_what_has_changed(cell: JobCell) -> None:
    product, other = cell.products[3], cell.stores[1]
    execution = _tool(cell, "execute", cell.order("late", 3))
    _wait_for_approvals(cell, 1)
    (approval,) = cell.rest.get("/api/approvals")["approvals"]
    wm = WorldModelInterface("tests")
    wm.set_relation(cell.shelf, "skiros:contain", product, False)
    wm.set_relation(other, "skiros:contain", product, True)
    before = cell.carried()
    assert cell.rest.post(f"/api/approvals/{approval['id']}/approve", {}, "approve")[0] == 200
    assert execution.result(60.0)["job"] == "late"
    response = cell.wait_for(["late"])["late"]["response"]
    assert (response["outcome"], response["steps"]) == ("failed", [])
    assert "the given plan no longer works" in response["message"] and product in response["message"]
    assert cell.carried() == before


def test_viewer_reads_and_does_not_answer_and_a_rejected_plan_does_not_run(page: Any, cell: JobCell) -> None:
    _log_in(page, TOKENS["view"])
    execution = _tool(cell, "execute", {**cell.order("rejected", 1, 1), "reason": "<b>bold</b>"})
    page.click("#approvals")
    playwright.expect(page.get_by_label("Waiting approvals").locator(".approval")).to_contain_text("<b>bold</b>")
    playwright.expect(page.locator("[data-action=approve]")).to_be_hidden()
    (approval,) = cell.rest.get("/api/approvals")["approvals"]
    assert cell.rest.post(f"/api/approvals/{approval['id']}/reject", {}, "approve")[0] == 200
    playwright.expect(page.get_by_label("Waiting approvals").locator(".approval")).to_have_count(0)
    assert "approve has rejected it" in execution.result(60.0)["detail"]
    assert "rejected" not in cell.jobs()


def test_agent_learns_the_reason_of_a_rejection_on_the_page(page: Any, cell: JobCell) -> None:
    _log_in(page, TOKENS["approve"])
    execution = _tool(cell, "execute", cell.order("refused", 1, 1))
    page.click("#approvals")
    page.fill("[data-field=reason]", "the store is being cleaned")
    page.click("[data-action=reject]")
    assert "approve has rejected it: the store is being cleaned" in execution.result(60.0)["detail"]


def test_ended_session_shows_the_login(page: Any, cell: JobCell) -> None:
    _log_in(page, TOKENS["operate"])
    playwright.expect(page.locator("#connection")).to_have_text("live")
    for session in cell.rest.get("/api/sessions")["sessions"]:
        assert cell.rest.request("DELETE", f"/api/sessions/{session['id']}", None, "maintain")[0] == 200
    page.reload()
    playwright.expect(page.locator("#token")).to_be_visible()
    assert page.evaluate("fetch('/api/state').then((answer) => answer.status)") == 401


def test_viewer_has_no_commands(page: Any) -> None:
    _log_in(page, "a guess of a token")
    playwright.expect(page.locator("dialog .problems")).not_to_be_empty()
    _log_in(page, TOKENS["view"])
    playwright.expect(page.locator(".left .card").first).to_be_visible()
    for button in ("#new-job", "#stop-all"):
        playwright.expect(page.locator(button)).to_be_hidden()


@pytest.fixture
def robot(cell: JobCell) -> Iterator[ManagerClient]:
    client = ManagerClient(ROBOT, "tests")
    yield client
    client.command("preempt", -1)
    wait_until(lambda: not client.read_tasks(), what="the end of all tasks")
    client.close()


def _move(robot: ManagerClient) -> None:
    """Starts a motion that runs until it is stopped."""
    skill = next(skill for skill in robot.read_skills() if skill.label == "wait_for_stop")
    robot.command("start", -1, [Step(skill.type, skill.label)])
    wait_until(robot.read_tasks, what="a task")


def _has_stopped(robot: ManagerClient) -> bool:
    return not robot.read_tasks()


@contextmanager
def _hung(*pids: int) -> Iterator[None]:
    """Processes that do not run, as on a machine that hangs."""
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)


def test_gateway_that_hangs_shows_no_data_and_stop_works(
    page: Any, cell: JobCell, robot: ManagerClient, tmp_path: Path
) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    connection = page.locator("#connection")
    expect(connection).to_have_text("live")
    _move(robot)
    page.wait_for_timeout(1500)  # the stop port learns of a session within half a second
    with _hung(cell.ros.master.node_pid("/gateway")):
        expect(connection).to_have_text(re.compile(r"no data for \d+ s"))
        expect(connection).to_have_class(re.compile("failure"))
        page.screenshot(path=str(tmp_path / "no_data.png"))
        page.click("#stop-all")
        wait_until(lambda: _has_stopped(robot), what="the end of the motion")
    expect(connection).to_have_text("live")


def test_world_model_and_task_manager_that_hang_are_shown_as_lost(page: Any, cell: JobCell, tmp_path: Path) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["view"])
    lost = page.locator(".left .lost .title2")
    expect(page.locator("#connection")).to_have_text("live")
    expect(lost).to_have_count(0)
    with _hung(*(cell.ros.master.node_pid(node) for node in ("/wm", "/tm"))):
        expect(lost).to_have_text(["task manager", "world model"])
        page.screenshot(path=str(tmp_path / "lost_parts.png"))
    expect(lost).to_have_count(0)


def test_stop_without_an_answer_shows_an_error_and_is_not_carried_out_later(
    page: Any, cell: JobCell, robot: ManagerClient
) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    expect(page.locator("#connection")).to_have_text("live")
    _move(robot)
    with _hung(cell.ros.master.node_pid("/gateway"), cell.stop_process()):
        page.click("#stop-all")
        expect(page.locator(".notice.failure")).to_have_text(re.compile("^Stop was not confirmed: "))
    expect(page.locator("#connection")).to_have_text("live")
    assert cell.rest.get("/api/state")["ready"] is not None  # the gateway has read what waited for it
    assert not _has_stopped(robot)
    page.click("#stop-all")
    wait_until(lambda: _has_stopped(robot), what="the end of the motion")


def test_eight_tabs_are_live_and_stop_works_in_the_last(page: Any, cell: JobCell, robot: ManagerClient) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    expect(page.locator("#connection")).to_have_text("live")
    tabs = [page.context.new_page() for _ in range(7)]
    for tab in tabs:
        tab.goto(page.url)
        expect(tab.locator("#connection")).to_have_text("live")
    _move(robot)
    for tab in (page, *tabs):
        expect(tab.locator(".left .card .chip", has_text="busy")).to_be_visible()
    tabs[-1].click("#stop-all")
    wait_until(lambda: _has_stopped(robot), what="the end of the motion")
    page.close()
    for tab in tabs:
        expect(tab.locator(".left .card .chip", has_text="idle")).to_be_visible()


@pytest.mark.long
def test_runs_of_a_killed_robot_end_as_lost(page: Any, cell: JobCell) -> None:
    expect = playwright.expect
    _log_in(page, TOKENS["operate"])
    expect(page.locator("#connection")).to_have_text("live")
    robot = ManagerClient(ROBOT, "tests")
    _move(robot)
    runs = page.locator(".left .list").nth(2).locator(".card").first.locator(".chip")
    expect(runs).to_have_text(re.compile("running"))

    def failed() -> int:
        return int(cell.rest.get("/api/state")["robots"][0]["counters"]["failed"])

    before = failed()
    cell.kill(ROBOT)  # it comes back before anybody could ask
    expect(runs).to_have_text(re.compile("lost"))
    assert failed() == before + 1
    robot.close()
