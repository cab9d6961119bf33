"""Goals as tasks: one tree of a goal, with the trees of its steps."""

from __future__ import annotations

import json
from typing import Any

import pytest

from skiros2_runs.core.frame import Frame
from skiros2_runs.core.goal_progress import after_feedback, after_result, new_goal
from skiros2_runs.core.goal_runs import GOALS, GoalRuns
from skiros2_runs.core.runs import Runs
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from support.progress import FAILURE, IDLE, RUNNING, SUCCESS, ProgressNode, fresh, root

TITLE = "Tray B contains Product A"


def _step(number: int, skill: str, robot: str = "/alpha") -> dict[str, Any]:
    planned = {"number": number, "skill": f"skiros:{skill.title()}", "label": skill, "robot": robot, "start": 0.0}
    return {**planned, "end": 1.0, "after": [], "arguments": {}}


def _state(number: int, state: str, message: str = "", **task: int) -> dict[str, Any]:
    return {"number": number, "robot": "/alpha", "state": state, "message": message, **task}


def _task(number: int, skill: str, state: int = RUNNING, inner: int = RUNNING, **of_root: Any) -> list[ProgressNode]:
    """The message of a task that runs a skill with a child."""
    nodes = [
        root(number, **of_root),
        ProgressNode(number + 1, number, skill, f"skiros:{skill.title()}", "->*", state, progress_time=1.0),
        ProgressNode(number + 2, number + 1, f"{skill}_arm", "skiros:Arm", state=inner),
    ]
    for node in nodes:
        node.task_id = number
    return nodes


class Cell:
    """Runs, goals, and a clock that advances by a second with each message."""

    def __init__(self) -> None:
        self.runs = Runs()
        self.goals = GoalRuns(self.runs)
        self.time = 1000.0
        self.data = new_goal("(contain b a)", self.time)

    def feedback(self, plan: list[dict[str, Any]], *states: dict[str, Any], phase: str = "running") -> TaskRun:
        self.time += 1.0
        self.data = after_feedback(self.data, phase, phase, json.dumps(plan), json.dumps(states), self.time)
        return self.goals.update("goal-1", TITLE, self.data, self.time).run

    def result(self, state: str, message: str, *done: dict[str, Any]) -> TaskRun:
        self.time += 1.0
        self.data = after_result(self.data, state, message, json.dumps(done), self.time)
        return self.goals.update("goal-1", TITLE, self.data, self.time).run

    def task(self, nodes: list[ProgressNode], robot: str = "/alpha") -> TaskRun:
        self.time += 1.0
        recorded = self.runs.record(robot, fresh(nodes), self.time)
        assert recorded is not None
        self.goals.step_recorded(recorded.run, self.time)
        return recorded.run


def _rows(frame: Frame) -> list[tuple[int, str, int]]:
    """Depth, name and state of each node."""
    return [(frame.shape.depths[i], frame.shape.name(i), frame.state(i)) for i in range(len(frame.shape))]


PLAN = [_step(1, "pick"), _step(2, "place")]


def test_steps_are_below_the_goal_before_during_and_after_their_tasks() -> None:
    cell = Cell()
    goal = cell.feedback([], phase="planning")
    assert _rows(goal.latest) == [(0, TITLE, RUNNING)] and goal.latest.shape.skills_text(3) == TITLE
    cell.feedback(PLAN, _state(1, "running"), _state(2, "waiting"))
    assert _rows(goal.latest) == [(0, TITLE, RUNNING), (1, "pick", RUNNING), (1, "place", IDLE)]
    pick = cell.task(_task(7, "pick"))
    assert cell.goals.goal_of(pick) is None  # its number is not known yet
    cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    assert cell.goals.goal_of(pick) is goal
    nodes = [(1, "pick", RUNNING), (2, "pick_arm", RUNNING), (1, "place", IDLE)]
    assert _rows(goal.latest) == [(0, TITLE, RUNNING), *nodes]
    cell.task(_ended(7, "pick"))
    cell.feedback(PLAN, _state(1, "succeeded", task=7), _state(2, "running", task=8))
    place = cell.task(_task(8, "place"))
    assert cell.goals.goal_of(place) is goal
    assert _rows(goal.latest)[1:] == [
        (1, "pick", SUCCESS), (2, "pick_arm", SUCCESS), (1, "place", RUNNING), (2, "place_arm", RUNNING),
    ]  # fmt: skip
    cell.task(_ended(8, "place"))
    assert not goal.is_finished
    cell.result("succeeded", "the goal is reached", *({**s, **_state(s["number"], "succeeded")} for s in PLAN))
    assert goal.state is TaskState.SUCCEEDED and goal.latest.message(0) == "the goal is reached"
    cell.feedback(PLAN, _state(2, "running", task=8))  # later than the result, by another connection
    assert goal.state is TaskState.SUCCEEDED
    assert [run.robot for run in cell.runs] == [GOALS, "/alpha", "/alpha"]
    assert list(cell.goals.tasks(goal)) == [pick, place]


def _ended(number: int, skill: str, state: int = SUCCESS) -> list[ProgressNode]:
    nodes = _task(number, skill, state, state)
    nodes[0] = root(number, state, 1 if state == SUCCESS else -1)
    return nodes


def test_new_plan_follows_what_was_done_and_drops_the_rest() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    cell.task(_ended(7, "pick", FAILURE))
    again = [_step(3, "pick", "/beta"), _step(4, "place", "/beta")]
    states = _state(1, "failed", "slipped", task=7), _state(3, "waiting"), _state(4, "waiting")
    cell.feedback([*PLAN[:1], *again], *states)
    assert _rows(goal.latest)[1:] == [
        (1, "pick", FAILURE), (2, "pick_arm", FAILURE), (1, "place", IDLE), (1, "pick", IDLE), (1, "place", IDLE),
    ]  # fmt: skip
    assert [goal.latest.message(i) for i in range(3, 6)] == ["replaced by another plan", "", ""]
    cell.result("cancelled", "cancelled by a client", {**PLAN[0], **_state(1, "failed", "slipped")})
    assert goal.state is TaskState.PREEMPTED


def test_earlier_ticks_show_the_goal_as_it_was() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    cell.task(_task(7, "pick"))
    before = cell.time
    cell.task(_ended(7, "pick"))
    assert (1, "pick", RUNNING) in _rows(goal.frame(goal.tick_at(before)))
    assert (1, "pick", SUCCESS) in _rows(goal.latest)
    assert goal.latest.shape.id(1) == goal.frame(0).shape.id(1), "a selected node stays selected"


def test_node_leads_to_the_task_it_comes_from() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    pick = cell.task(_task(7, "pick"))
    shape = goal.latest.shape
    assert [cell.goals.origin(goal, shape.id(i)) for i in range(4)] == [None, (pick, 8), (pick, 9), None]
    assert cell.goals.origin(pick, 9) == (pick, 9)
    assert cell.goals.id_of(goal) == "goal-1" and cell.goals.id_of(pick) == ""


def test_task_of_an_earlier_goal_with_the_same_number_is_not_taken() -> None:
    cell = Cell()
    old = cell.task(_ended(7, "pick"))
    cell.time += 100.0
    cell.data = new_goal("(contain b a)", cell.time)
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    assert cell.goals.goal_of(old) is None and _rows(goal.latest)[1] == (1, "pick", RUNNING)
    new = cell.task(_task(7, "pick"))
    assert cell.goals.goal_of(new) is goal
    other = cell.task(_task(7, "pick"), "/beta")
    assert cell.goals.goal_of(other) is None


def test_goal_with_only_paused_steps_is_paused() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    cell.task(_task(7, "pick", status=TaskState.PAUSED))
    assert goal.state is TaskState.PAUSED
    cell.task(_task(7, "pick"))
    assert goal.state is TaskState.RUNNING


def test_step_of_a_lost_robot_has_failed() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    cell.task(_task(7, "pick"))
    cell.runs.mark_lost("/alpha")
    cell.feedback(PLAN, _state(1, "failed", "/alpha has disappeared", task=7), _state(2, "waiting"))
    assert _rows(goal.latest)[1] == (1, "pick", FAILURE) and goal.latest.message(1) == "/alpha has disappeared"


def test_step_continues_with_a_robot_that_was_silent() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    cell.task(_task(7, "pick"))
    cell.runs.mark_lost("/alpha")
    again = cell.task(_ended(7, "pick"))
    assert cell.goals.goal_of(again) is goal
    assert _rows(goal.latest)[1] == (1, "pick", SUCCESS)


def test_step_ends_with_its_task_not_before() -> None:
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    cell.task(_task(7, "pick"))
    cell.feedback(PLAN, _state(1, "succeeded", task=7), _state(2, "running"))  # earlier than the task's last message
    assert [state for _, _, state in _rows(goal.latest)[1:3]] == [RUNNING, RUNNING]
    cell.time -= 1.5  # it is received later, and was sent earlier
    cell.task(_ended(7, "pick"))
    assert [state for _, _, state in _rows(goal.latest)[1:3]] == [SUCCESS, SUCCESS]
    assert goal.times == sorted(goal.times)


def test_unchanged_nodes_stay_the_same_objects() -> None:
    """Also over ROS, where a receiver keeps the nodes that have not changed."""
    cell = Cell()
    goal = cell.feedback(PLAN, _state(1, "running", task=7), _state(2, "waiting"))
    nodes = _task(7, "pick")
    cell.runs.record("/alpha", nodes, cell.time)
    run = list(cell.runs)[1]
    cell.goals.step_recorded(run, cell.time)
    before = goal.nodes
    cell.runs.record("/alpha", [nodes[0], fresh(nodes)[1], nodes[2]], cell.time + 1.0)
    cell.goals.step_recorded(run, cell.time + 1.0)
    assert [old is new for old, new in zip(before, goal.nodes, strict=True)] == [False, True, True, True]


@pytest.mark.parametrize("text", ["{", "[3]", '{"a": 1}', "[{}]"])
def test_unreadable_progress_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        after_feedback(new_goal("(a b)", 1.0), "running", "", text, "", 2.0)
