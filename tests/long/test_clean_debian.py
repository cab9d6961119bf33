"""A newcomer on a clean Debian 12: the commands of the README, all tutorials, and the container, as they are written.

Each runs in a chroot, which has nothing but git and make. Times are kept in build/newcomer.txt.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest

from skiros2_common.core.processes import free_port
from support.chroot import Chroot, can_make, make_base
from support.newcomers import PAGES
from support.programs import Program
from support.ros import ROOT, wait_until
from support.setups import PIP
from support.tutorial import needs

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not can_make(), reason="a chroot needs root and debootstrap"),
]
#: Goals (s) on two free cores, with Debian's archive and the package index at 10 MB/s: from `git clone` to the moving
#: robot, from the demo's first line to its end, and from the second `make demo` to its first line.
MOVING_ROBOT, RUN, SECOND_START = 100, 30, 3
#: A slower network or other load may take this many times as long. An idle machine passes with 1.
MARGIN = float(os.environ.get("MARGIN", "2"))
STARTS = "Starting a system of its own"
#: Follows a tutorial with a Python.
FOLLOW = "PYTHONPATH=skiros2/tests:skiros2/skiros2/skiros2_common/src {} -m support.tutorial skiros2/docs/tutorials/{}"
TIMES = ROOT / "build/newcomer.txt"


def note(what: str, seconds: float, goal: float | None = None) -> None:
    with TIMES.open("a") as file:
        file.write(f"{seconds:7.1f} s  {what}{f' (goal: {goal} s)' if goal else ''}\n")


def newcomer_on(base: Path, folder: Path) -> Chroot:
    """A clean system with a clone."""
    return cloned(Chroot(base, folder))


def cloned(chroot: Chroot) -> Chroot:
    """Makes the clone, unless it is there."""
    if not (chroot.home / "skiros2").exists():
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(chroot.home / "skiros2")], check=True)
    return chroot


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    TIMES.write_text("")
    return make_base(tmp_path_factory.mktemp("debian") / "base")


@pytest.fixture(scope="module")
def newcomer(base: Path, tmp_path_factory: pytest.TempPathFactory) -> Chroot:
    """A clean system, for the first test without a clone."""
    return Chroot(base, tmp_path_factory.mktemp("newcomer"))


def test_robot_moves_soon_and_the_second_time_at_once(newcomer: Chroot) -> None:
    begin = time.monotonic()
    cloned(newcomer)
    demo = Program(newcomer.command("cd skiros2 && exec make demo"))
    try:
        demo.wait_for_line(STARTS, MARGIN * MOVING_ROBOT)
        started = time.monotonic()
        demo.wait_for_line("▶ drive", MARGIN * MOVING_ROBOT)
        moved = time.monotonic() - begin
        assert demo.wait(2 * MARGIN * RUN) == 0, demo.output
        run = time.monotonic() - started
    finally:
        demo.stop()
    for step, seconds in re.findall(r"^(\[\d/3\] .*)\n(?:    .*\n)*?    .* \((\S+) s\)$", demo.output, re.M):
        note(step, float(seconds))
    note("from the clone to the moving robot", moved, MOVING_ROBOT)
    note("the run", run, RUN)
    assert "The goal is reached" in demo.output
    assert demo.output.count("\n  make demo ") == 2  # what to type next
    begin = time.monotonic()
    again = Program(newcomer.command("cd skiros2 && exec make demo"))
    try:
        again.wait_for_line(STARTS, 10 * MARGIN * SECOND_START)
        second = time.monotonic() - begin
        note("make demo again, to its first line", second, SECOND_START)
        assert again.wait(4 * MARGIN * RUN) == 0, again.output
        note("make demo again", time.monotonic() - begin)
    finally:
        again.stop()
    assert moved < MARGIN * MOVING_ROBOT
    assert run < MARGIN * RUN
    assert second < MARGIN * SECOND_START


@pytest.mark.parametrize("setup", list(dict.fromkeys(needs(page).setup for page in PAGES)))
def test_tutorials_show_what_happens_after_their_set_up(newcomer: Chroot, setup: str) -> None:
    cloned(newcomer)
    begin = time.monotonic()
    newcomer.run(f"cd skiros2 && {setup} DEMO_ARGS=--version")
    note(setup, time.monotonic() - begin)
    for page in [page for page in PAGES if needs(page).setup == setup]:
        begin = time.monotonic()
        newcomer.run(f"ROS_MASTER_URI=http://localhost:21311 {FOLLOW.format('skiros2/.venv/bin/python3', page.name)}")
        note(page.name, time.monotonic() - begin)


def test_tutorial_without_ros_shows_what_happens(base: Path, tmp_path: Path) -> None:
    chroot = newcomer_on(base, tmp_path)
    chroot.run("apt-get -q update && apt-get -qy install --no-install-recommends python3-venv")
    begin = time.monotonic()
    chroot.run(f"python3 -m venv plain && cd skiros2 && ~/plain/bin/{PIP} -q")
    note(PIP, time.monotonic() - begin)
    begin = time.monotonic()
    chroot.run("plain/bin/skiros2 try")
    note("skiros2 try", time.monotonic() - begin)
    chroot.run(f". plain/bin/activate && {FOLLOW.format('python3', '17_without_ros.md')}")


def instructions(dockerfile: Path) -> list[tuple[str, str]]:
    """The instructions of a Dockerfile, each with its text."""
    text = re.sub(r"\\\n\s*", "", re.sub(r"^#.*\n", "", dockerfile.read_text(), flags=re.M))
    return [(line.partition(" ")[0], line.partition(" ")[2]) for line in text.splitlines() if line]


def request(address: str, token: str, body: dict[str, Any] | None = None) -> str:
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    with urlopen(Request(address, json.dumps(body).encode() if body else None, headers)) as answer:
        return str(answer.read().decode())


def test_container_shows_the_page_and_takes_a_job(base: Path, tmp_path: Path) -> None:
    """Follows the instructions of the Dockerfile, as `docker build` does, and then runs its command."""
    chroot = Chroot(base, tmp_path)
    folder, user, command = "/", "root", ""
    begin = time.monotonic()
    for kind, text in instructions(ROOT / "Dockerfile"):
        if kind == "RUN":
            chroot.run(f"cd {folder} && export HOME=/root && {text}")
        elif kind == "COPY":
            assert text == ". /skiros2"
            subprocess.run(["git", "clone", "--quiet", str(ROOT), str(chroot.changed / "skiros2")], check=True)
            shutil.rmtree(chroot.changed / "skiros2/.git")
        elif kind == "WORKDIR":
            folder = text
        elif kind == "USER":
            user = text
        elif kind == "CMD":
            (command,) = json.loads(text)
        else:
            assert (kind, text) in (("FROM", "debian:bookworm-slim"), ("EXPOSE", "8765 8766")), kind
    note("the container's image", time.monotonic() - begin)
    port = free_port()  # the container has the network of this machine
    as_user = f"exec setpriv --reuid={user} --init-groups env HOME=/home/{user} PORT={port}"
    container = Program(chroot.command(f"{as_user} {command}"))
    try:
        token = container.wait_for_line(r"Open http://localhost:\d+ and log in with the token (\S+)", 180)[1]
        (host, *_) = subprocess.check_output(["hostname", "-I"], text=True).split()
        address = f"http://{host}:{port}"
        assert "<title>" in urlopen(address).read().decode()
        parameters = {"Product": "skiros:Product-14", "Tray": "demo:Tray-12"}
        request(f"{address}/api/jobs", token, {"id": "1", "work_master": "put_in_tray", "parameters": parameters})
        wait_until(lambda: '"Ended"' in request(f"{address}/api/jobs/1", token), 180)
        assert '"succeeded"' in request(f"{address}/api/jobs/1", token)
    finally:
        container.stop()
