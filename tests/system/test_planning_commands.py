"""The commands of `rosrun skiros2_task`, with and without a world model."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from skiros2_common.core.world_element import Element
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.planning_world import PlanningWorld, transport_world
from support.ros import Ros, install_environment, run_command

Run = Callable[..., "subprocess.CompletedProcess[str]"]

DEMO = Path(__file__).parents[2] / "skiros2_std_lib/demos/timed_skills/owl/pick_place_scene.ttl"
DEMO_GOAL = "(skiros:contain demo:Tray-12 skiros:Product-14)"


@pytest.fixture
def world(ros: Ros) -> PlanningWorld:
    """Two robots, three places, one product at the first."""
    ros.run("skiros2_world_model", "world_model_server_node", name="wm")
    return transport_world(robots=2, places=3, wm=WorldModelInterface("tests"))


@pytest.fixture
def run(ros: Ros, tmp_path: Path) -> Run:
    """Runs a command to its end."""

    def run(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        env = {**ros.master.env, "HOME": str(tmp_path)}
        return run_command(["rosrun", "skiros2_task", name, *arguments], env)

    return run


def test_planning_does_not_change_the_running_world_model(run: Run, world: PlanningWorld) -> None:
    before = {e.id: e.printState(verbose=True) for e in world.wm.resolve_elements(Element())}
    goal = f"(skiros:contain {world.places[1]} {world.products[0]})"
    planned = run("plan", goal)
    assert (planned.returncode, planned.stderr) == (0, "")
    assert planned.stdout.startswith("3 steps of 1 robot, ")
    previewed = run("preview", goal)
    assert (previewed.returncode, previewed.stderr) == (0, "")
    assert previewed.stdout.splitlines()[-1] == "the goal holds at the end"
    explained = run("explain", goal)
    assert f"     makes {goal} for the goal" in explained.stdout.splitlines()
    assert {e.id: e.printState(verbose=True) for e in world.wm.resolve_elements(Element())} == before


def test_plan_for_a_single_robot(run: Run, world: PlanningWorld) -> None:
    goal = f"(skiros:contain {world.places[1]} {world.products[0]})"
    planned = json.loads(run("plan", goal, "--robot", "beta", "--json").stdout)
    assert {step["robot"] for step in planned["steps"]} == {"/beta"}
    unknown = run("plan", goal, "--robot", "gamma")
    assert (unknown.returncode, unknown.stdout) == (1, "")
    assert unknown.stderr == "plan: no robot /gamma offers skills; there are: /alpha, /beta\n"


def test_plan_command_explains_why_there_is_no_plan(run: Run, world: PlanningWorld) -> None:
    for robot, gripper in zip(world.robots, world.grippers, strict=True):
        world.wm.set_relation(robot, "skiros:hasA", gripper, False)
    explained = run("explain", f"(skiros:contain {world.places[1]} {world.products[0]})")
    assert (explained.returncode, explained.stderr) == (1, "")
    sentence, verdict, *_ = explained.stdout.splitlines()
    assert re.fullmatch(r"No plan: GripperEffector-\d+ is nowhere: tests removed it from \w+ at .* ago\)\.", sentence)
    assert verdict.startswith("verdict: proven impossible")


def test_command_without_a_world_model_fails_with_a_message(run: Run) -> None:
    for command in ("plan", "preview", "explain"):
        refused = run(command, "(a b)")
        assert (refused.returncode, refused.stdout) == (3, "")
        assert refused.stderr.startswith(f"{command}: there is no world model /wm on the master ")


def test_scene_files_need_no_master(tmp_path: Path) -> None:
    env = {**install_environment(), "ROS_MASTER_URI": "http://127.0.0.1:1", "HOME": str(tmp_path)}
    command = ["rosrun", "skiros2_task", "plan", DEMO_GOAL, "--scene", str(DEMO), "--libraries", "skiros2_demo_skills"]
    planned = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert (planned.returncode, planned.stderr) == (0, "")
    assert planned.stdout.startswith("4 steps of 1 robot, ")
