"""Re-runs with unchanged code are as recorded: of the bags in the repository, and of a fresh recording of each demo."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from support.programs import Program
from support.ros import ROOT, install_environment

pytestmark = [pytest.mark.long, pytest.mark.timeout(7200)]

#: Re-runs of each bag, and recordings of each demo. Every second one is made beside a busy process on each core.
RERUNS, RECORDINGS = int(os.environ.get("RERUNS", "4")), int(os.environ.get("RECORDINGS", "1"))

BAGS = ROOT / "tests" / "bags"
DEMOS = ROOT / "skiros2_std_lib" / "demos"
#: Where the ontologies of the bags in the repository are; the recorded folder is that of another machine.
WORKSPACES = {
    "contact": DEMOS / "piston/scene", "simulated": DEMOS / "pick_and_place/owl", "timed": DEMOS / "timed_skills/owl",
}  # fmt: skip
#: Not to be re-run, see tests/bags/README.md.
TO_READ = "pick_place.bag"

RECORDED = {
    "pick-place": ["rosrun", "skiros2_demo", "pick_place_demo", "--no-pictures"],
    "pick-place disturbed": ["rosrun", "skiros2_demo", "pick_place_demo", "--no-pictures", "--disturb", "moved",
                             "--disturb", "slip"],
    "piston": ["rosrun", "skiros2_piston_demo", "piston_demo", "--no-pictures"],
    "connector": ["rosrun", "skiros2_connector_demo", "connector_demo", "--no-pictures"],
    "factory": ["rosrun", "skiros2_factory_demo", "factory_demo", "--no-pictures"],
    "push": [sys.executable, "-m", "support.produce_push"],  # insertion-learning has no nodes, and no bag
}  # fmt: skip


def environment(home: Path) -> dict[str, str]:
    found = {**install_environment(), "HOME": str(home)}
    found.pop("ROS_MASTER_URI", None)
    folders = [str(ROOT / "tests"), str(ROOT / "tests" / "libraries"), found.get("PYTHONPATH", "")]
    return {**found, "PYTHONPATH": os.pathsep.join(folders)}


@contextmanager
def load() -> Iterator[None]:
    """A busy process on each core."""
    busy = [Program([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for program in busy:
            program.stop()


def rerun(bag: Path, home: Path, *options: str) -> None:
    """Re-runs a bag as users do, prints the row of a table, and asserts that nothing has diverged."""
    command = ["rosrun", "skiros2_bags", "replay", str(bag), "--json", *options]
    times, orders, wrong = [], [], []
    for number in range(RERUNS):
        with load() if number % 2 else nullcontext():
            begin = time.monotonic()
            done = subprocess.run(command, env=environment(home), capture_output=True, text=True, check=False)
            times.append(time.monotonic() - begin)
        if done.returncode:
            wrong.append(done.stdout + done.stderr)
        else:
            orders.append(json.loads(done.stdout)["orders"])
    seconds = f"{min(times):.1f} to {max(times):.1f} s"
    print(f"| {bag} | {RERUNS} re-runs | {len(wrong)} divergences | {max(orders, default=0)} orders | {seconds} |")
    assert not wrong, f"{len(wrong)} of {RERUNS}: {wrong[0]}"


@pytest.mark.parametrize("name", sorted(bag.name for bag in BAGS.glob("*.bag") if bag.name != TO_READ))
def test_bag_of_the_repository_is_as_recorded(name: str, tmp_path: Path) -> None:
    workspace = WORKSPACES.get(name.partition("_")[0].removesuffix(".bag"))
    rerun(BAGS / name, tmp_path, *(["--workspace", str(workspace)] if workspace else []))


@pytest.mark.parametrize("number", range(RECORDINGS))
@pytest.mark.parametrize("demo", RECORDED)
def test_fresh_recording_of_a_demo_is_as_recorded(demo: str, number: int, tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    options = [str(folder)] if demo == "push" else ["--folder", str(folder)]
    program = Program([*RECORDED[demo], *options], environment(tmp_path), cwd=tmp_path)
    try:
        with load() if number % 2 else nullcontext():
            status = program.wait(1200)
    finally:
        program.stop()
    print(f"{demo}{' beside load' * (number % 2)} has ended with status {status}")  # its own tests demand success
    assert (folder / "run.bag").is_file(), program.output
    rerun(folder / "run.bag", tmp_path)
