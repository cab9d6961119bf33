"""The demo with physics, as `make demo` runs it, with disturbances."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

from skiros2_bags.testing.recording import Recording
from skiros2_bags.testing.rerun import Settings, rerun
from support.demo_run import DemoRun
from support.programs import descendants
from support.ros import ROOT, wait_until

WORKSPACE = ROOT / "skiros2_std_lib/demos/pick_and_place/owl"

#: What is true at the end, in the bag and in the simulated world.
PROOF = (
    "at the end: Product A is in Tray B",
    "Product A is within Tray B",
    "it stands on it",
    "it is upright",
    "it is at rest",
    "no robot touches it",
)

MOVED, SLIPPED = "somebody puts Product A into Tray C", "Gripper loses its grip"


@pytest.fixture
def run(tmp_path: Path) -> Iterator[DemoRun]:
    run = DemoRun(tmp_path)
    yield run
    if run.program is not None:
        run.program.stop()


@pytest.mark.timeout(240)  # three plans, on a machine that is busy
def test_product_is_in_the_other_tray_despite_disturbances(run: DemoRun) -> None:
    program = run.start("--disturb", "moved", "--disturb", "slip", "--seed", "5")
    program.wait_for_line("The tree as it runs", 60)
    run.family = descendants(program.pid)
    status = program.wait(170)
    shown = program.output
    assert status == 0, shown
    moved, slipped = (shown.index(f"  ! {told}\n") for told in (MOVED, SLIPPED))
    plans = [shown.index("\nPlan ("), *(m.start() for m in re.finditer("^New plan: ", shown, re.MULTILINE))]
    assert plans[0] < moved < plans[1] < slipped < plans[2], shown
    assert re.findall(r"^  \d\. (\w+)", shown[: plans[1]], re.MULTILINE) == [
        "drive", "look", "pick", "drive", "look", "place",
    ]  # fmt: skip
    assert re.search("^New plan: .*(Tray C|needs that Tray A contains Product A)", shown, re.MULTILINE), shown
    assert re.search("^New plan: .*Product A is not between the fingers", shown, re.MULTILINE)
    assert "✗ " not in shown.partition("\nProof from the bag alone")[2], shown
    for words in PROOF:
        assert re.search(rf"^  ✓ {words}", shown, re.MULTILINE), f"not proven: {words}\n{shown}"
    for moment in ("before", "during", "after"):
        for of, size in (("cell", (640, 480)), ("robot", (320, 240))):
            picture = Image.open(run.folder / "demo" / f"{moment}_{of}.png")
            assert picture.size == size
            assert len(picture.getcolors(1 << 20)) > 5, f"there is nothing in the picture {moment} of the {of}"
    status, checked = run.check_run(run.bag)
    assert status == 0, checked
    assert run.nothing_left()
    again = rerun(Recording(run.bag), Settings(WORKSPACE))
    assert again.is_as_recorded, again
    assert not any("the recording does not have it" in line for line in again.not_compared)


@pytest.mark.long
def test_ctrl_c_while_driving_ends_all_processes_in_order(run: DemoRun) -> None:
    program = run.start("--no-pictures")
    program.wait_for_line("▶ drive", 60)
    run.family = descendants(program.pid)
    program.interrupt()
    assert program.wait(40) == 128 + signal.SIGINT
    assert "pick_place_demo: stopped" in program.output
    wait_until(run.nothing_left)


def test_window_and_disturbance_require_the_simulator(run: DemoRun) -> None:
    status, shown = run.end("--timed", "--disturb", "slip")
    assert status == 2
    assert "--timed has no simulated world to disturb or to show" in shown
