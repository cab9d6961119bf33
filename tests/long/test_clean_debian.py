"""A newcomer on a clean Debian 12: the commands of the README, all tutorials, and the container's image, as they are written.

Each command runs in a chroot, which has nothing but git and make. Times are kept in build/newcomer.txt.
"""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import pytest

from support.chroot import Chroot, can_make, make_base
from support.newcomers import PAGES
from support.programs import Program
from support.ros import ROOT
from support.setups import PIP
from support.tutorial import needs

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not can_make(), reason="a chroot needs root and debootstrap"),
]
#: From the clone to the end of the demo on two quiet cores: 100 s. Here others may need them, too.
FIRST_RUN = 400
#: From the command to the demo's first line (s).
SECOND_RUN = 3
TIMES = ROOT / "build/newcomer.txt"


def note(what: str, seconds: float) -> None:
    with TIMES.open("a") as file:
        file.write(f"{seconds:7.1f} s  {what}\n")


def newcomer_on(base: Path, folder: Path) -> Chroot:
    """A clean system with a clone."""
    chroot = Chroot(base, folder)
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(chroot.home / "skiros2")], check=True)
    return chroot


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    TIMES.write_text("")
    return make_base(tmp_path_factory.mktemp("debian") / "base")


@pytest.fixture(scope="module")
def newcomer(base: Path, tmp_path_factory: pytest.TempPathFactory) -> Chroot:
    return newcomer_on(base, tmp_path_factory.mktemp("newcomer"))


def test_robot_moves_soon_and_the_second_time_at_once(newcomer: Chroot) -> None:
    begin = time.monotonic()
    shown = newcomer.run("cd skiros2 && make demo")
    taken = time.monotonic() - begin
    note("make demo", taken)
    assert "The goal is reached" in shown
    assert shown.count("\n  make demo ") == 2  # what to type next
    assert taken < FIRST_RUN
    begin = time.monotonic()
    again = Program(newcomer.command("cd skiros2 && exec make demo"))
    try:
        again.wait_for_line("Starting a system of its own.*")
        started = time.monotonic() - begin
        note("make demo again, to its first line", started)
        assert again.wait(300) == 0
        note("make demo again", time.monotonic() - begin)
    finally:
        again.stop()
    assert started < SECOND_RUN


@pytest.mark.parametrize("setup", sorted({needs(page).setup for page in PAGES}))
def test_tutorials_show_what_happens_after_their_set_up(newcomer: Chroot, setup: str) -> None:
    newcomer.run(f"cd skiros2 && {setup} DEMO_ARGS=--version")
    for page in [page for page in PAGES if needs(page).setup == setup]:
        begin = time.monotonic()
        script = "PYTHONPATH=skiros2/tests:skiros2/skiros2/skiros2_common/src skiros2/.venv/bin/python3 -m support.tutorial"
        newcomer.run(f"export ROS_MASTER_URI=http://localhost:21311; {script} skiros2/docs/tutorials/{page.name}")
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
    script = "PYTHONPATH=skiros2/tests:skiros2/skiros2/skiros2_common/src python3 -m support.tutorial"
    chroot.run(f". plain/bin/activate && {script} skiros2/docs/tutorials/17_without_ros.md")
