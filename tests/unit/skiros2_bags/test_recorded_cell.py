"""Goals in bags as tasks."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from skiros2_bags.core.action_call import ASSIGN, ActionCall, Goal
from skiros2_bags.core.bag_file import Message
from skiros2_bags.core.recorded_cell import goal_indices, recorded_cell
from skiros2_bags.core.run import Run
from skiros2_runs.core.goal_runs import GOALS
from support.ros import ROOT


def test_tasks_of_steps_belong_to_their_goal() -> None:
    cell = recorded_cell(Run.open(ROOT / "tests/bags/timed_goal.bag"))
    assert [task.robot for task in cell.runs] == [GOALS, *["/mobile_manipulator"] * 4]
    assert goal_indices(cell) == dict.fromkeys(range(1, 5), 0)


def test_bag_without_goals_has_its_tasks() -> None:
    run = Run.open(ROOT / "tests/bags/gripper.bag")
    cell = recorded_cell(run)
    assert goal_indices(cell) == {}
    assert [(task.robot, task.task_id, len(task)) for task in cell.runs] == [
        (task.robot, task.task_id, len(task)) for task in run.tasks()
    ]


def test_goal_that_was_only_planned_is_no_task() -> None:
    result = SimpleNamespace(result=SimpleNamespace(progress_code=3, progress_message="[]"))
    call = ActionCall("/tm/task_plan", ASSIGN, "1", result=cast(Message, SimpleNamespace(content=result, time=2.0)))
    goal = Goal(1.0, "(a b)", "user", 2.0, "plan_found", "[]", call)
    run = SimpleNamespace(topics={}, goals=lambda: [goal], messages=lambda *_: (), need=lambda *_: None)
    assert recorded_cell(cast(Run, run)).goals == {}
