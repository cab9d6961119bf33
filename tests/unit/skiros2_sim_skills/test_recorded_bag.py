"""Checks of a stored bag."""

from pathlib import Path

import pytest

from skiros2_demo.run_check import GoalRun, changes, check, read_run
from skiros2_runs.core.task_run import TaskRun
from support.progress import FAILURE, ProgressNode, root

BAG = Path(__file__).parents[2] / "bags" / "pick_place.bag"


@pytest.fixture
def run() -> GoalRun:
    return read_run(BAG)


def test_recorded_run_passes_all_checks(run: GoalRun) -> None:
    found = check(run)
    assert all(finding.holds for finding in found)
    assert [finding.text for finding in found] == [
        "the bag has all of the run from its start",
        "a plan was made: drive, pick, drive, place",
        "/mobile_manipulator did: drive, pick, drive, place",
        "at the end: Product A is in Tray B",
    ]


def test_world_before_and_after_is_read(run: GoalRun) -> None:
    told = changes(run.before, run.after)
    assert {"- Tray A skiros:contain Product A", "+ Tray B skiros:contain Product A"} <= {*told}
    assert "+ mobile_manipulator skiros:at Workstation 2" in told
    assert {run.after.name(i) for i in run.after.things} >= {"Tray A", "Tray B", "Product B", "Product C", "Gripper"}


def test_missing_product_fails_the_check(run: GoalRun) -> None:
    run.after.relations = run.before.relations
    assert [finding.text for finding in check(run) if not finding.holds] == ["at the end: Product A is in Tray B"]


def test_failed_skill_fails_the_check(run: GoalRun) -> None:
    failed = TaskRun(run.tasks[-1].robot, 5)
    failed.record([root(state=FAILURE, code=-1), ProgressNode(6, 5, "place", state=FAILURE)], run.tasks[-1].start)
    run.tasks[-1] = failed
    told = "drive, pick, drive, place (failed); reported: drive, pick, drive, place"
    assert [finding.text for finding in check(run) if not finding.holds] == [f"/mobile_manipulator did: {told}"]
