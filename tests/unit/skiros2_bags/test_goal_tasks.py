"""Goals in bags as tasks."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from skiros2_bags.core.action_call import ASSIGN, ActionCall, Goal
from skiros2_bags.core.bag_file import Message
from skiros2_bags.core.goal_tasks import recorded_goals, recorded_tasks
from skiros2_bags.core.run import Run
from skiros2_runs.core.goal_runs import GOALS
from support.ros import ROOT


def test_tasks_of_steps_belong_to_their_goal() -> None:
    tasks, goal_of = recorded_tasks(Run.open(ROOT / "tests/bags/timed_goal.bag"))
    assert [task.robot for task in tasks] == [GOALS, *["/mobile_manipulator"] * 4]
    assert goal_of == dict.fromkeys(range(1, 5), 0)


def test_bag_without_goals_has_its_tasks() -> None:
    run = Run.open(ROOT / "tests/bags/gripper.bag")
    tasks, goal_of = recorded_tasks(run)
    assert goal_of == {}
    assert [(task.robot, task.task_id, len(task)) for task in tasks] == [
        (task.robot, task.task_id, len(task)) for task in run.tasks()
    ]


def test_goal_that_was_only_planned_is_no_task() -> None:
    result = SimpleNamespace(result=SimpleNamespace(progress_code=3, progress_message="[]"))
    call = ActionCall("/tm/task_plan", ASSIGN, "1", result=cast(Message, SimpleNamespace(content=result, time=2.0)))
    goal = Goal(1.0, "(a b)", "user", 2.0, "plan_found", "[]", call)
    assert recorded_goals(cast(Run, SimpleNamespace(topics={}, goals=lambda: [goal]))) == {}
