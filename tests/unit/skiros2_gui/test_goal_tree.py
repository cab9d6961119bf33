"""Goals in the list of tasks and in the tab "Running": one tree with the trees of the steps."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.world_element import Element
from skiros2_gui.app.tasks import PAUSE, STOP, is_silent, message_text, skills_text
from skiros2_gui.run.presenter import RunPresenter
from skiros2_live.core.patch import TASK_MANAGER, Connection, GoalProgress, TaskProgress
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.values import NodeStatus
from support.progress import FAILURE, IDLE, RUNNING, SUCCESS, ProgressNode, root
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window

PLAN = [
    {"number": number, "skill": f"skiros:{skill.title()}", "label": skill, "robot": "/robot", "arguments": {}}
    for number, skill in ((1, "pick"), (2, "place"))
]


class Robot:
    """A manager that notes what it is asked."""

    name = "/robot"

    def __init__(self) -> None:
        self.commands: list[tuple[str, int]] = []
        self.inspected: list[tuple[int, int]] = []

    def command(self, action: str, task_id: int, skills: Any = ()) -> int:
        self.commands.append((action, task_id))
        return task_id

    def read_tasks(self, task_id: int = -1) -> list[Any]:
        return []

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        self.inspected.append((task_id, node_id))
        return NodeStatus(node_id, "skiros:Arm", "arm")


class TaskManager:
    def __init__(self) -> None:
        self.cancelled: list[str] = []
        self.active_goals = frozenset({"goal-1"})

    def cancel_goal(self, goal_id: str) -> None:
        self.cancelled.append(goal_id)


class Lab:
    def __init__(self) -> None:
        self.window = make_window(LocalSystem)
        system: Any = self.window.system
        self._queue = system._event_queue
        system._managers["/robot"] = self.robot = Robot()
        system.planner = self.planner = TaskManager()
        tray = Element("skiros:LargeBox", "Tray B")
        tray.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        self.tray = system.world.add_element(tray).id
        self.presenter = RunPresenter(self.window)
        self.time = time.time()

    @property
    def rows(self) -> list[str]:
        return [f"{skills_text(run)}: {run.state}" for run in self.window.tasks.rows]

    def goal(self, **message: Any) -> None:
        self.time += 0.1
        self._queue.put(GoalProgress("goal-1", SimpleNamespace(**message), self.time))
        self.window.process_events()

    def send(self) -> None:
        self.goal(goal=SimpleNamespace(goals=f"(skiros:contain {self.tray} skiros:Product-9)"))

    def feedback(self, *states: dict[str, Any]) -> None:
        fields = {"phase": "running", "message": "", "plan": json.dumps(PLAN), "steps": json.dumps(states)}
        self.goal(feedback=SimpleNamespace(**fields))

    def task(self, number: int, skill: str, state: int = RUNNING) -> None:
        self.time += 0.1
        nodes = [
            root(number, state, {SUCCESS: 1, FAILURE: -1}.get(state, 0)),
            ProgressNode(number + 1, number, skill, f"skiros:{skill.title()}", "->*", state),
            ProgressNode(number + 2, number + 1, f"{skill}_arm", "skiros:Arm", state=state),
        ]
        for node in nodes:
            node.task_id = number
        self.window.publish(TaskProgress("/robot", nodes, self.time))


@pytest.fixture
def lab() -> Iterator[Lab]:
    made = Lab()
    yield made
    made.window.system._managers.clear()  # type: ignore[attr-defined]
    made.window.system.close()


def _shown(lab: Lab) -> list[tuple[str, int]]:
    frame = lab.presenter.frame
    assert frame is not None
    return [(frame.shape.name(i), frame.state(i)) for i in range(len(frame.shape))]


def _start(lab: Lab) -> TaskRun:
    """A goal whose first step runs as task 7."""
    lab.send()
    lab.feedback({"number": 1, "state": "running", "task": 7}, {"number": 2, "state": "waiting"})
    lab.task(7, "pick")
    run = lab.window.tasks.rows[0]
    assert run.robot == GOALS
    return run


def test_goal_is_one_task_with_all_its_steps(lab: Lab) -> None:
    goal = _start(lab)
    assert lab.rows == ["Tray B contains Product-9: running"] and lab.presenter.run is goal
    arm = ("pick_arm", RUNNING)
    assert _shown(lab) == [("Tray B contains Product-9", RUNNING), ("pick", RUNNING), arm, ("place", IDLE)]
    lab.task(7, "pick", SUCCESS)
    lab.feedback({"number": 1, "state": "succeeded", "task": 7}, {"number": 2, "state": "running", "task": 8})
    lab.task(8, "place")
    assert [state for _, state in _shown(lab)] == [RUNNING, SUCCESS, SUCCESS, RUNNING, RUNNING]
    assert message_text(goal) == "place_arm" and lab.presenter.run is goal
    lab.task(8, "place", SUCCESS)
    lab.goal(result=SimpleNamespace(state="succeeded", message="the goal is reached", done="[]"))
    lab.feedback({"number": 2, "state": "running", "task": 8})  # later than the result, by another connection
    assert lab.rows == ["Tray B contains Product-9: succeeded"]
    assert [run.robot for run in lab.presenter.runs] == [GOALS]


def test_task_is_replaced_by_its_goal_once_that_is_known(lab: Lab) -> None:
    lab.send()
    lab.presenter.pick(lab.window.tasks.rows[0])
    lab.task(7, "pick")
    assert len(lab.rows) == 2
    task = lab.window.tasks.find("/robot", 7)
    assert task is not None
    lab.presenter.pick(task)
    lab.feedback({"number": 1, "state": "running", "task": 7}, {"number": 2, "state": "waiting"})
    assert len(lab.rows) == 1
    run = lab.presenter.run
    assert run is not None and run.robot == GOALS


def test_details_of_a_node_come_from_the_task_of_its_step(lab: Lab) -> None:
    _start(lab)
    lab.presenter.select(2)
    assert lab.robot.inspected == [(7, 9)] and lab.presenter.robot_at(2) == "/robot"
    for index in (0, 3):  # the goal, and a step that has not started
        lab.presenter.select(index)
        text = lab.presenter.node_text(index)
        assert text is not None and text.title == ("Tray B contains Product-9", "", "", "place")[index]
    assert lab.robot.inspected == [(7, 9)] and lab.presenter.robot_at(0) == ""
    assert (lab.presenter.robot, lab.presenter.robot_at(3)) == ("/robot", "/robot")


def test_commands_for_a_goal_concern_its_running_tasks_and_stop_cancels_it(lab: Lab) -> None:
    goal = _start(lab)
    lab.window.tasks.command(PAUSE, goal.robot, goal.task_id)
    assert lab.robot.commands == [("pause", 7)]
    lab.presenter.command(STOP)
    assert lab.planner.cancelled == ["goal-1"] and lab.robot.commands == [("pause", 7)]


def test_goal_of_a_task_manager_that_has_disappeared_is_lost(lab: Lab) -> None:
    goal = _start(lab)
    assert not is_silent(goal, lab.time + 1000.0)
    lab.window.system.planner = None  # type: ignore[misc]
    lab.window.publish(Connection(TASK_MANAGER, "/tm", False, 1.0))
    assert goal.state is TaskState.LOST and message_text(goal) == "the task manager no longer reports it"


def test_goal_whose_result_was_lost_is_lost_until_it_arrives(lab: Lab) -> None:
    goal = _start(lab)
    lab.window.tasks.check(lab.time + 60.0)
    assert goal.state is TaskState.RUNNING, "the task manager still works on it"
    lab.planner.active_goals = frozenset()
    lab.window.tasks.check(lab.time + 1.0)
    assert goal.state is TaskState.RUNNING, "the result may be on its way"
    lab.window.tasks.check(lab.time + 60.0)
    assert lab.rows[0] == "Tray B contains Product-9: lost"
    assert message_text(goal) == "the task manager no longer reports it"
    lab.goal(result=SimpleNamespace(state="succeeded", message="the goal is reached", done="[]"))
    assert lab.rows == ["Tray B contains Product-9: succeeded"]


def test_failed_goal_says_why(lab: Lab) -> None:
    goal = _start(lab)
    lab.task(7, "pick", FAILURE)
    lab.goal(result=SimpleNamespace(state="failed", message=f"no plan is left for {lab.tray}", done="[]"))
    lab.window.tasks.ask_why(goal)
    assert lab.window.tasks.why == ("no plan is left for Tray B",)
    assert goal.latest.failed() == [2]


def test_unreadable_message_is_reported(lab: Lab) -> None:
    lab.goal(feedback=SimpleNamespace(phase="running", message="", plan="{", steps="[]"))
    assert "cannot be read" in lab.window.problems.history[0].text
    assert lab.rows == []


def test_question_of_a_client_is_no_goal(lab: Lab) -> None:
    lab.goal(goal=SimpleNamespace(goals=""))
    assert lab.rows == []
