"""Planning with the skills and the scene of the simulated robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_task.core.planning import TaskPlanner, Verdict
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.skilled_scene import planner_of, scene_with_skills, steps

SCENE = Path(__file__).parents[3] / "skiros2_std_lib/demos/pick_and_place/owl/sim_scene.ttl"
TRAY_B, TRAY_C, TRAY_D = "demo:Tray-12", "demo:Tray-11", "demo:Tray-13"
PRODUCT_A, PRODUCT_B = "skiros:Product-14", "skiros:Product-15"


@pytest.fixture(scope="module")
def wmi() -> LocalWorldModel:
    """The scene with the robot and its skills."""
    skills = ["drive", "look", "pick", "place", "move_base", "tuck_arm", "detect_objects"]
    return scene_with_skills("skiros2_sim_skills", SCENE, {"mobile_manipulator": skills})


@pytest.fixture(scope="module")
def planner(wmi: LocalWorldModel) -> Iterator[TaskPlanner]:
    with planner_of(wmi) as planner:
        yield planner


def test_plan_looks_at_each_workstation(planner: TaskPlanner) -> None:
    plan = steps(planner, f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    assert plan == ["drive", "look", "pick", "drive", "look", "place"]


def test_plan_looks_once_per_workstation(planner: TaskPlanner) -> None:
    assert steps(planner, f"(skiros:contain {TRAY_C} {PRODUCT_A})") == ["drive", "look", "pick", "place"]


def test_plan_empties_a_full_tray_first(planner: TaskPlanner) -> None:
    plan = steps(planner, f"(skiros:contain {TRAY_D} {PRODUCT_A})")
    assert plan.count("pick") == plan.count("place") == 2


def test_plan_avoids_occupied_places(planner: TaskPlanner, wmi: LocalWorldModel) -> None:
    (station,) = [e for e in wmi.get_scene_elements() if e.label == "Workstation 2"]
    station.setProperty("demo:Free", False)
    wmi.update_element_properties(station)
    result = planner.plan(f"(skiros:contain {TRAY_B} {PRODUCT_A})")
    station.setProperty("demo:Free", True)
    wmi.update_element_properties(station)
    assert result.verdict is Verdict.IMPOSSIBLE


def test_scene_uses_known_names_only(wmi: LocalWorldModel) -> None:
    assert [str(finding) for finding in wmi.validate().findings] == []
