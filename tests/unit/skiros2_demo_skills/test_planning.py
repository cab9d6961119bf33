"""Planning with the skills and the scene of the demo."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_task.core.planning import TaskPlanner, Verdict
from support.skilled_scene import planner_of, scene_with_skills, steps

SCENE = Path(__file__).parents[3] / "skiros2_std_lib/demos/timed_skills/owl/pick_place_scene.ttl"
TRAY_A, TRAY_B, TRAY_C = "demo:Tray-10", "demo:Tray-12", "demo:Tray-11"
PRODUCT_A, PRODUCT_B = "skiros:Product-14", "skiros:Product-15"


@pytest.fixture(scope="module")
def planner() -> Iterator[TaskPlanner]:
    """Plans with the demo's robot and skills."""
    skills = ["drive", "pick", "place", "move_base_timed", "move_arm_timed"]
    wmi = scene_with_skills("skiros2_demo_skills", SCENE, {"mobile_manipulator": skills})
    with planner_of(wmi) as planner:
        yield planner


def test_plan_fetches_a_product_from_the_other_workstation(planner: TaskPlanner) -> None:
    result = planner.plan(f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    assert [call.label for call in result.calls] == ["drive", "pick", "drive", "place"]
    assert {call.manager for call in result.calls} == {"/mobile_manipulator"}
    pick = {key: element.id for key, element in result.calls[1].arguments}
    assert pick == {
        "Robot": "cora:Robot-1",
        "Object": PRODUCT_A,
        "Container": TRAY_A,
        "Workstation": "demo:Workstation-6",
        "Arm": "rparts:ArmDevice-3",
        "Gripper": "rparts:GripperEffector-4",
    }


def test_a_product_for_the_same_workstation_needs_one_drive(planner: TaskPlanner) -> None:
    assert steps(planner, f"(skiros:contain {TRAY_C} {PRODUCT_A})") == ["drive", "pick", "place"]


def test_the_gripper_holds_one_product_at_a_time(planner: TaskPlanner) -> None:
    plan = steps(planner, f"(skiros:contain {TRAY_B} {PRODUCT_A}), (skiros:contain {TRAY_A} {PRODUCT_B})")
    assert [step for step in plan if step != "drive"] == ["pick", "place"] * 2


def test_satisfied_goal_needs_no_plan(planner: TaskPlanner) -> None:
    assert planner.plan(f"(skiros:contain {TRAY_A} {PRODUCT_A})").verdict is Verdict.NOTHING_TO_DO


def test_a_tray_cannot_be_moved(planner: TaskPlanner) -> None:
    result = planner.plan(f"(skiros:contain demo:Workstation-7 {TRAY_A})")
    assert result.verdict is Verdict.IMPOSSIBLE
