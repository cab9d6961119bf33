"""A killed task manager: the next one continues its goals, and their clients get their results."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import actionlib
import pytest
from actionlib_msgs.msg import GoalStatus

from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_msgs.msg import AchieveResult
from skiros2_skill.ros.discovery_interface import DiscoverableNode
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_task.core.goal_store import GoalStore
from skiros2_task.core.store import Durations
from skiros2_task.ros.step_runner import ManagerStepRunner
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.planning_world import PlanningWorld
from support.ros import Ros, wait_until

pytestmark = pytest.mark.timeout(120)

TESTS = Path(__file__).resolve().parents[1]
WAIT = 60.0  # s


class Cell:
    """A robot `/porter` that hauls products in its gripper from a shelf to a store."""

    def __init__(self, ros: Ros, folder: Path, **params: Any) -> None:
        self.ros = ros
        self._folder = folder
        self._params = params
        self.start_world_model()
        self.wm = WorldModelInterface("tests")
        world = PlanningWorld(self.wm)
        self.shelf, self.store = world.thing("skiros:Location"), world.thing("skiros:Location")
        self.products = [world.thing("skiros:Product", inside=self.shelf) for _ in range(2)]
        robot = world.thing("cora:Robot", "skiros:porter")
        self.gripper = world.gripper(robot)
        self.start_robot()
        self.start_task_manager()
        ros.service("/porter/get_skills", srvs.ResourceGetDescriptions)()
        wait_until(lambda: "/tm/achieve/status" in ros.master.topics(), WAIT, "the task manager")

    def start_world_model(self) -> None:
        params = {"journal": str(self._folder / "journal")}
        self.ros.run("skiros2_world_model", "world_model_server_node", name="wm", params=params)

    def start_robot(self) -> None:
        env = {**self.ros.master.env, "PYTHONPATH": f"{TESTS}:{self.ros.master.env['PYTHONPATH']}"}
        params = {"libraries_list": ["support.hauling_skills"], "primitive_list": ["haul"], "prefix": "skiros"}
        self.ros.run("skiros2_skill", "skill_manager_node", name="porter", params=params, env=env)

    def start_task_manager(self) -> None:
        self.ros.run("skiros2_task", "task_manager_node", name="tm", params=self._params or None)

    def achieve(self) -> Request:
        return Request(f"(forall (?p - skiros:Product) (skiros:contain {self.store} ?p))")

    def content(self, place: str) -> list[str]:
        return sorted(r["dst"] for r in self.wm.get_element(place).getRelations("-1", "skiros:contain"))

    def moves(self) -> list[str]:
        """The products that were put into the store, again for each time."""
        found = [r for entry in self.wm.history(self.store) for r in entry.related if r["src"] == self.store]
        return sorted(r["dst"] for r in found if r["type"] == "skiros:contain")

    def set_on_restart(self, goal_id: str, on_restart: str) -> None:
        answer = self.ros.service("/tm/on_restart", srvs.GoalOnRestart)(goal_id, on_restart)
        assert answer.ok, answer.text


class Request:
    """A goal of actionlib's plain client."""

    def __init__(self, goal: str) -> None:
        self._client = actionlib.ActionClient("tm/achieve", msgs.AchieveAction)
        assert self._client.wait_for_server()
        self.feedback: list[Any] = []
        self._handle = self._client.send_goal(
            msgs.AchieveGoal("tests", goal, "", 0.0, 0, -1), None, lambda _, feedback: self.feedback.append(feedback)
        )

    @property
    def id(self) -> str:
        return str(self._handle.comm_state_machine.action_goal.goal_id.id)

    def wait_for(self, condition: Callable[[Any], Any]) -> None:
        wait_until(lambda: self.feedback and condition(self.feedback[-1]), WAIT, "feedback as wanted")

    def cancel(self) -> None:
        self._handle.cancel()

    @property
    def result(self) -> Any:
        wait_until(lambda: self._handle.get_comm_state() == actionlib.CommState.DONE, WAIT, "the end of the goal")
        assert self._handle.get_terminal_state() != GoalStatus.LOST
        return self._handle.get_result()


def hauls(feedback: Any) -> bool:
    return any(step["state"] == "running" for step in json.loads(feedback.steps))


def states(result: Any) -> list[str]:
    return [step["state"] for step in json.loads(result.done)]


def test_killed_task_manager_continues_with_the_step_that_runs(ros: Ros, tmp_path: Path) -> None:
    goals = tmp_path / "tm.goals"
    earlier = GoalStore(goals)
    earlier.set_meta("managers", ["/gone"])  # of a process that has ended its goals: nobody waits for it
    earlier.close()
    cell = Cell(ros, tmp_path, goals=str(goals))
    porter = SkillManagerInterface("/porter", "tests")
    request = cell.achieve()
    request.wait_for(hauls)
    (task,) = wait_until(lambda: list(porter.tasks), WAIT, "the porter's task")
    porter.pause_one(task)
    ros.kill_node("/tm")
    cell.start_task_manager()
    wait_until(lambda: "/tm/on_restart" in ros.master.services(), WAIT, "the next task manager")
    porter.command("start", task)
    result = request.result
    assert (result.state, result.message) == (AchieveResult.SUCCEEDED, "the goal is reached")
    assert states(result) == ["succeeded", "succeeded"]
    assert cell.content(cell.store) == cell.moves() == sorted(cell.products)
    porter.shutdown()


def test_manager_that_ran_before_the_subscription_is_reported(ros: Ros, tmp_path: Path) -> None:
    """Else it is not stored among the managers for which the next task manager waits."""
    porter = DiscoverableNode()
    porter.init_discovery("/skill_managers", "/porter")
    runner = ManagerStepRunner("tests", Durations(tmp_path / "durations.json"))
    wait_until(lambda: runner.agents, WAIT, "the manager")
    found: list[str] = []
    runner.subscribe(found.append, lambda _: None)
    assert found == ["/porter"]
    runner.shutdown()
    porter.stop_discovery()


@pytest.mark.long
def test_power_failure_while_the_robot_holds_something_asks(ros: Ros, tmp_path: Path) -> None:
    cell = Cell(ros, tmp_path)
    request = cell.achieve()
    (held,) = wait_until(lambda: cell.content(cell.gripper), WAIT, "a held product")
    for node in ("/wm", "/porter", "/tm"):
        ros.kill_node(node)
    cell.start_world_model()
    cell.start_robot()
    cell.start_task_manager()
    request.wait_for(lambda feedback: feedback.phase == "asking")
    assert f"/porter holds {held}" in request.feedback[-1].message
    assert cell.content(cell.gripper) == [held]
    cell.wm.set_relation(cell.gripper, "skiros:contain", held, False)  # a person puts it back
    cell.wm.set_relation(cell.shelf, "skiros:contain", held)
    cell.set_on_restart(request.id, "continue")
    result = request.result
    assert result.state == AchieveResult.SUCCEEDED, result.message
    assert states(result) == ["failed", "succeeded", "succeeded"]
    assert cell.content(cell.store) == cell.moves() == sorted(cell.products)


@pytest.mark.long
def test_goal_that_is_to_end_after_a_restart_is_reported(ros: Ros, tmp_path: Path) -> None:
    cell = Cell(ros, tmp_path, on_restart="abort")
    request = cell.achieve()
    wait_until(lambda: cell.content(cell.gripper), WAIT, "a held product")
    ros.kill_node("/tm")
    cell.start_task_manager()
    result = request.result
    assert result.state == AchieveResult.FAILED
    assert states(result) in (["stopped"], ["succeeded"])  # it may have ended before the next task manager
    assert "on_restart is abort" in result.message
