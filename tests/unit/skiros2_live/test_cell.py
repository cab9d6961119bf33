"""The document of a cell, from patches as the adapters report them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_live.core.cell import CellDocument, GoalChanged, RobotChanged, RunsLost
from skiros2_live.core.patch import (
    TASK_MANAGER,
    Connection,
    EntriesChanged,
    GoalProgress,
    ManagerConnection,
    SafetyChanged,
    TaskProgress,
)
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.states import TaskState
from support.progress import FAILURE, SUCCESS, ProgressNode, root

ROBOT = "/robot"
GOAL = "(skiros:contain demo:Tray-1 skiros:Product-2)"


@pytest.fixture
def cell() -> CellDocument:
    return CellDocument(clock=lambda: 100.0, max_goals=2)


def record(cell: CellDocument, stamp: float, node: ProgressNode) -> None:
    cell.apply(TaskProgress(ROBOT, [node], stamp))


def send(cell: CellDocument, text: str = GOAL, goal_id: str = "goal") -> None:
    cell.apply(GoalProgress(goal_id, SimpleNamespace(goal=SimpleNamespace(goals=text)), 1.0))


def test_message_older_than_the_last_counts_only_if_it_is_the_end(cell: CellDocument) -> None:
    record(cell, 2.0, root(1))
    record(cell, 1.0, root(1, message="late"))
    [run] = cell.runs
    assert len(run) == 1 and run.latest.time == 2.0
    record(cell, 1.0, root(1, SUCCESS, 1))
    assert run.state is TaskState.SUCCEEDED
    record(cell, 0.5, root(1))
    assert list(cell.runs) == [run], "an answer that was given before the end starts no task"


def test_tasks_of_a_disconnected_robot_are_lost_and_count_as_failed(cell: CellDocument) -> None:
    lost: list[RunsLost] = []
    states: list[str] = []
    cell.subscribe(RunsLost, lost.append)
    cell.subscribe(RobotChanged, lambda change: states.append(change.robot.state))
    cell.apply(ManagerConnection(ROBOT, True))
    record(cell, 1.0, root(1))
    cell.apply(SafetyChanged(ROBOT, "emergency_stop", "button", ("emergency stop by button",), 1.0))
    cell.apply(SafetyChanged(ROBOT, "running", "", (), 2.0))
    cell.apply(ManagerConnection(ROBOT, False))
    assert states == ["idle", "busy", "emergency_stop", "busy", "disconnected"]
    assert [run.state for change in lost for run in change.runs] == [TaskState.LOST]
    assert cell.robots_data()[0]["counters"]["failed"] == 1


def _aged(node: ProgressNode, seconds: float) -> ProgressNode:
    """The message of a task that has run for that time."""
    node.progress_time = seconds
    return node


@pytest.mark.parametrize("is_still_running", [True, False])
def test_task_of_a_robot_that_was_silent_counts_as_what_it_ends_as(cell: CellDocument, is_still_running: bool) -> None:
    record(cell, 1.0, root(1))
    cell.apply(ManagerConnection(ROBOT, False))
    [run] = cell.runs
    assert (run.state, cell.robots_data()[0]["counters"]["failed"]) == (TaskState.LOST, 1)
    cell.apply(ManagerConnection(ROBOT, True))
    if is_still_running:
        record(cell, 9.0, _aged(root(1), 8.0))
        [robot] = cell.robots_data()
        assert (run.state, robot["state"], robot["counters"]["failed"]) == (TaskState.RUNNING, "busy", 0)
    record(cell, 10.0, _aged(root(1, SUCCESS, 1), 9.0))
    assert (list(cell.runs), run.state) == ([run], TaskState.SUCCEEDED)
    counters = cell.robots_data()[0]["counters"]
    assert (counters["succeeded"], counters["failed"], counters["quality"]) == (1, 0, 1.0)


@pytest.mark.parametrize("continues", [True, False])
def test_progress_that_comes_before_the_connection_counts_the_task_once(cell: CellDocument, continues: bool) -> None:
    record(cell, 1.0, root(1))
    cell.apply(ManagerConnection(ROBOT, False))
    record(cell, 9.0, _aged(root(1), 8.0))
    cell.apply(ManagerConnection(ROBOT, True))
    if continues:
        record(cell, 10.0, _aged(root(1), 9.0))
    [robot], [run] = cell.robots_data(), cell.runs
    expected = (TaskState.RUNNING, "busy", 0) if continues else (TaskState.LOST, "idle", 1)
    assert (run.state, robot["state"], robot["counters"]["failed"]) == expected


def test_task_whose_last_report_is_that_before_the_silence_continues(cell: CellDocument) -> None:
    record(cell, 4.0, _aged(root(1), 3.25))
    cell.apply(ManagerConnection(ROBOT, False))
    cell.apply(ManagerConnection(ROBOT, True))
    record(cell, 9.0, _aged(root(1), 3.25))
    [run] = cell.runs
    assert (run.state, cell.robots_data()[0]["counters"]["failed"]) == (TaskState.RUNNING, 0)


def test_task_with_a_single_message_before_the_silence_continues(cell: CellDocument) -> None:
    record(cell, 4.0, root(1))
    cell.apply(ManagerConnection(ROBOT, False))
    cell.apply(ManagerConnection(ROBOT, True))
    record(cell, 9.0, _aged(root(1), 4.9))  # each message is some time on its way
    [run] = cell.runs
    assert (run.state, cell.robots_data()[0]["counters"]["failed"]) == (TaskState.RUNNING, 0)


def test_task_that_only_a_viewer_has_marked_as_lost_is_not_counted_when_it_continues(cell: CellDocument) -> None:
    record(cell, 1.0, root(1))
    [run] = cell.runs
    run.is_lost = True  # the robot is connected, and has not reported the task for some time
    record(cell, 9.0, _aged(root(1), 8.0))
    record(cell, 10.0, _aged(root(1, SUCCESS, 1), 9.0))
    counters = cell.robots_data()[0]["counters"]
    assert (run.state, counters["succeeded"], counters["failed"]) == (TaskState.SUCCEEDED, 1, 0)


@pytest.mark.parametrize("has_returned", [False, True])
def test_task_that_has_ended_unseen_counts_as_what_the_robot_says(cell: CellDocument, has_returned: bool) -> None:
    record(cell, 4.0, _aged(root(1), 3.0))
    cell.apply(ManagerConnection(ROBOT, False))
    cell.apply(ManagerConnection(ROBOT, True))
    if has_returned:
        record(cell, 9.0, _aged(root(1), 8.0))
    for _ in range(2):
        cell.apply(TaskProgress(ROBOT, [_aged(root(1, SUCCESS, 1), 9.0)], 60.0, is_past=True))
    [run], [robot] = cell.runs, cell.robots_data()
    assert (run.state, run.latest.time) == (TaskState.SUCCEEDED, 10.0)
    assert (robot["counters"]["succeeded"], robot["counters"]["failed"], robot["state"]) == (1, 0, "idle")


@pytest.mark.parametrize(
    "ended",
    [
        _aged(root(1, SUCCESS, 1), 2.0),  # it has run for less time
        _aged(root(1, SUCCESS, 1), 100.0),  # it has run since before
        replace(_aged(root(1, SUCCESS, 1), 9.0), label="another"),
        _aged(root(2, SUCCESS, 1), 9.0),
    ],
)
def test_past_end_of_another_task_changes_nothing(cell: CellDocument, ended: ProgressNode) -> None:
    record(cell, 4.0, _aged(root(1), 3.0))
    cell.apply(ManagerConnection(ROBOT, False))
    cell.apply(TaskProgress(ROBOT, [ended], 60.0, is_past=True))
    [run] = cell.runs
    assert (run.state, cell.robots_data()[0]["counters"]["failed"]) == (TaskState.LOST, 1)


def test_task_of_a_restarted_robot_does_not_continue_a_lost_one_with_its_number(cell: CellDocument) -> None:
    record(cell, 1.0, root(1))
    cell.apply(ManagerConnection(ROBOT, False))
    cell.apply(ManagerConnection(ROBOT, True))
    record(cell, 9.0, _aged(root(1), 0.5))
    record(cell, 10.0, _aged(root(1, SUCCESS, 1), 1.5))
    assert [run.state for run in cell.runs] == [TaskState.LOST, TaskState.SUCCEEDED]
    counters = cell.robots_data()[0]["counters"]
    assert (counters["succeeded"], counters["failed"]) == (1, 1)


def test_task_that_ends_in_its_first_message_counts(cell: CellDocument) -> None:
    def counts() -> tuple[float, float]:
        counters = cell.robots_data()[0]["counters"]
        return counters["succeeded"], counters["failed"]

    changes: list[RobotChanged] = []
    cell.subscribe(RobotChanged, changes.append)
    record(cell, 1.0, root(1, SUCCESS, 1))
    assert len(changes) == 2  # it has connected, and succeeded
    record(cell, 1.5, root(1, SUCCESS, 1))
    record(cell, 2.0, root(2, FAILURE, -1))
    assert counts() == (1, 1)
    cell.apply(ManagerConnection(ROBOT, False))  # its numbers begin again
    record(cell, 3.0, root(1, SUCCESS, 1))
    assert counts() == (2, 1)


def test_goals_of_a_task_manager_that_has_disconnected_are_lost(cell: CellDocument) -> None:
    changes: list[Connection] = []
    cell.subscribe(Connection, changes.append)
    up = Connection(TASK_MANAGER, "/tm", True, 1.0)
    cell.apply(up)
    send(cell)
    [goal] = cell.runs
    assert goal.state is TaskState.RUNNING
    down = up.updated(False, "It was killed.")
    assert down.since > up.since and down.updated(False).since == down.since
    cell.apply(down)
    assert goal.state is TaskState.LOST
    send(cell)
    assert goal.state is TaskState.RUNNING, "it continues when the task manager is there again"
    assert [run.robot for run in cell.shown] == [GOALS]
    assert changes == [up, down] and cell.connections == {TASK_MANAGER: down}


def test_title_of_a_goal_has_the_labels_of_its_elements(cell: CellDocument) -> None:
    cell.apply(EntriesChanged("elements", {"demo:Tray-1": {"label": "Tray B"}}))
    send(cell)
    assert cell.goals["goal"]["title"] == "Tray B contains Product-2"
    assert [run.robot for run in cell.shown] == [GOALS]


def test_client_that_asks_for_its_goal_changes_nothing(cell: CellDocument) -> None:
    send(cell)
    before = dict(cell.goals["goal"])
    send(cell, "")
    assert cell.goals == {"goal": before}


@pytest.mark.parametrize("plan", ["{", "[1]", "{}"])
def test_message_that_cannot_be_read_changes_nothing(cell: CellDocument, plan: str) -> None:
    send(cell)
    before = dict(cell.goals["goal"])
    feedback = SimpleNamespace(phase="running", message="", plan=plan, steps="")
    with pytest.raises(WrongValue, match="cannot be read"):
        cell.apply(GoalProgress("goal", SimpleNamespace(feedback=feedback), 2.0))
    assert cell.goals == {"goal": before}


def test_oldest_goals_are_discarded(cell: CellDocument) -> None:
    removed: list[Any] = []
    cell.subscribe(GoalChanged, lambda change: removed.append(change.goal_id) if change.data is None else None)
    for number in range(4):
        send(cell, goal_id=f"goal-{number}")
    assert removed == ["goal-0", "goal-1"] and list(cell.goals) == ["goal-2", "goal-3"]


def test_entries_are_replaced_one_by_one_or_as_a_whole(cell: CellDocument) -> None:
    cell.apply(EntriesChanged("frames", {"a": [1], "b": [2]}))
    cell.apply(EntriesChanged("frames", {"a": None, "c": [3]}))
    assert cell.tables["frames"] == {"b": [2], "c": [3]}
    cell.apply(EntriesChanged("frames", {"d": [4]}, is_whole=True))
    assert cell.tables["frames"] == {"d": [4]}
