"""The skills of the simulated robot and their scene are all that planning needs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.skilled_scene import planner_of, scene_with_skills, steps

TRAY_B, TRAY_C, TRAY_D = "demo:Tray-12", "demo:Tray-11", "demo:Tray-13"
PRODUCT_A, PRODUCT_B = "skiros:Product-14", "skiros:Product-15"


@pytest.fixture(scope="module")
def wmi() -> LocalWorldModel:
    """The scene with the robot and its skills."""
    skills = ["drive", "look", "pick", "place", "move_base", "tuck_arm", "detect_objects"]
    return scene_with_skills("skiros2_sim_skills", "sim_scene.ttl", {"mobile_manipulator": skills})


@pytest.fixture(scope="module")
def planner(wmi: LocalWorldModel) -> Iterator[TaskPlanner]:
    with planner_of(wmi) as planner:
        yield planner


def test_a_robot_looks_before_it_works_and_again_where_it_has_come_to(planner: TaskPlanner) -> None:
    plan = steps(planner, f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    assert plan == ["drive", "look", "pick", "drive", "look", "place"]


def test_one_look_is_enough_for_what_is_done_at_one_workstation(planner: TaskPlanner) -> None:
    assert steps(planner, f"(skiros:contain {TRAY_C} {PRODUCT_A})") == ["drive", "look", "pick", "place"]


def test_a_full_tray_is_emptied_before_something_is_placed_in_it(planner: TaskPlanner) -> None:
    plan = steps(planner, f"(skiros:contain {TRAY_D} {PRODUCT_A})")
    assert plan.count("pick") == plan.count("place") == 2


def test_nobody_drives_to_where_another_robot_stands(planner: TaskPlanner, wmi: LocalWorldModel) -> None:
    (station,) = [e for e in wmi.get_scene_elements() if e.label == "Workstation 2"]
    station.setProperty("demo:Free", False)
    wmi.update_element_properties(station)
    result = planner.plan(f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    station.setProperty("demo:Free", True)
    wmi.update_element_properties(station)
    assert result.verdict is Verdict.IMPOSSIBLE


def test_the_scene_has_no_word_that_is_not_known(wmi: LocalWorldModel) -> None:
    assert [str(finding) for finding in wmi.validate().findings] == []
