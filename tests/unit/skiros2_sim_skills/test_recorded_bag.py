"""A bag that was recorded once stays readable, and proves what happened then."""

from pathlib import Path

import pytest

from skiros2_demo.changes import changes
from skiros2_demo.run_check import Run, check, read_run

BAG = Path(__file__).parents[2] / "bags" / "pick_place.bag"


@pytest.fixture
def run() -> Run:
    return read_run(BAG)


def test_the_recorded_run_is_proven(run: Run) -> None:
    found = check(run)
    assert all(finding.holds for finding in found)
    assert [finding.text for finding in found] == [
        "a plan was made: drive, pick, drive, place",
        "the plan was followed",
        "/mobile_manipulator, task 0: all 18 skills succeeded",
        "at the end: Product A is in Tray B",
    ]


def test_the_world_before_and_after_is_known(run: Run) -> None:
    told = changes(run.before, run.after)
    assert "Product A is in Tray B; it was in Tray A" in told
    assert "mobile_manipulator is at Workstation 2; it was at Charging station" in told
    assert {run.after.name(i) for i in run.after.things} >= {"Tray A", "Tray B", "Product B", "Product C", "Gripper"}


def test_a_product_that_had_not_arrived_would_be_noticed(run: Run) -> None:
    run.after.relations = run.before.relations
    assert [finding.text for finding in check(run) if not finding.holds] == ["at the end: Product A is in Tray B"]


def test_a_skill_that_had_failed_would_be_noticed(run: Run) -> None:
    ((_, nodes),) = run.trees.items()
    skill = next(node for node in nodes if node.label == "close_gripper_timed")
    skill.state = skill.FAILURE
    assert any("close_gripper_timed ended as Failure" in finding.text for finding in check(run) if not finding.holds)
