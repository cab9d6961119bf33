"""The cell of three robots: scene, plan, and the robot that cannot drive."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_sim.core.scene_reader import load_scene
from skiros2_sim.core.world import World
from skiros2_skill.testing import SkillBench
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.planners import Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from support.skilled_scene import scene_with_skills

ROOT = Path(__file__).parents[3]
OWL = ROOT / "skiros2_std_lib/demos/pick_and_place/owl"
SCENE = OWL / "three_robots_scene.ttl"
GOAL = """(skiros:contain demo:Tray-34 skiros:Product-40), (skiros:contain demo:Tray-35 skiros:Product-41),
    (skiros:contain demo:Tray-37 skiros:Product-42)"""
DELIVERY = "demo:Workstation-22"
ROBOTS = {"mobile_1": ["drive", "look", "pick", "place"], "mobile_2": ["drive", "look", "pick", "place"]}
ROBOTS["stationary"] = ["look", "pick", "place"]


@pytest.fixture(scope="module")
def plan() -> Iterator[PlanningResult]:
    wmi = scene_with_skills("skiros2_sim_skills", SCENE, ROBOTS)
    processes = EngineProcesses()
    yield TaskPlanner(wmi, planner_named(processes, Quality.BEST.value), Limits(10.0)).plan(GOAL)
    processes.close()


def test_plan_uses_all_three_robots(plan: PlanningResult) -> None:
    assert plan.verdict is Verdict.PLANNED, plan.message
    assert {call.manager for call in plan.calls} == {"/mobile_1", "/mobile_2", "/stationary"}
    placed = {call.manager: dict(call.arguments)["Object"].label for call in plan.calls if call.label == "place"}
    assert placed["/stationary"] == "Product C"
    assert {placed["/mobile_1"], placed["/mobile_2"]} == {"Product A", "Product B"}


def test_plan_has_one_robot_at_the_delivery_at_a_time(plan: PlanningResult) -> None:
    assert plan.plan is not None
    stays = []
    for robot in ("/mobile_1", "/mobile_2"):
        times = [
            (step.start, step.end, {key: element.id for key, element in step.call.arguments})
            for step in plan.plan.steps
            if step.call.manager == robot and step.call.label == "drive"
        ]
        comes = [start for start, _, arguments in times if arguments["TargetLocation"] == DELIVERY]
        leaves = [end for _, end, arguments in times if arguments["StartLocation"] == DELIVERY]
        stays += list(zip(sorted(comes), [*sorted(leaves), math.inf], strict=False))
    assert len(stays) >= 2
    assert all(left <= came for (_, left), (came, _) in pairwise(sorted(stays)))


def test_plan_is_parallel(plan: PlanningResult) -> None:
    assert plan.plan is not None
    assert plan.plan.makespan < 0.7 * sum(step.end - step.start for step in plan.plan.steps)


def test_scene_has_no_problems_in_the_simulator() -> None:
    scene = load_scene(SCENE, OWL)
    with World(scene) as world:
        assert not world.problems
        assert {robot.name: robot.mobile for robot in world.robots.values()} == {
            "mobile_1": True,
            "mobile_2": True,
            "stationary": False,
        }
        world.step(240)
        touching = {(contact.first, contact.second) for contact in world.contacts()}
        assert touching == {
            ("demo:Tray-32", "skiros:Product-40"),
            ("demo:Tray-33", "skiros:Product-41"),
            ("demo:Tray-36", "skiros:Product-42"),
        }
        # the pedestal is under the arm
        pedestal = world.robots["cora:Robot-11"].link_pose("pedestal").position
        mount = world.pose_of("rparts:ArmDevice-13").position
        assert pedestal == pytest.approx((mount[0], mount[1], mount[2] / 2))


def stand(place: str, **moved: float) -> tuple[State, str]:
    bench = SkillBench(SCENE).import_libraries("skiros2_std_skills", "skiros2_sim_skills")
    bench.robot = bench.element("demo:stationary")
    for key, value in moved.items():
        bench.robot.setProperty(f"skiros:{key}", value)
    bench.wmi.update_element(bench.robot)
    skill = bench.command("MoveBase", "stand_still", TargetLocation=bench.element(place)).run().skill
    return skill.state, skill.progress_msg


def test_stand_still_succeeds_at_its_place() -> None:
    assert stand("Packing table") == (State.Success, "At Packing table")


def test_stand_still_fails_elsewhere() -> None:
    state, message = stand("Delivery")
    assert state is State.Failure
    assert message == "demo:stationary cannot drive, and Delivery is 4.12 m away"


def test_stand_still_fails_after_a_move() -> None:
    state, message = stand("Packing table", PositionX=-0.8)
    assert state is State.Failure
    assert "0.30 m away" in message
