"""The action server of the task manager, called with actionlib's lock held."""

from __future__ import annotations

import threading
from typing import Any

from actionlib_msgs.msg import GoalID

from skiros2_msgs.msg import AssignTaskGoal
from skiros2_task.core.planning import PlanningResult, Verdict
from skiros2_task.ros.task_manager import TaskManager


class NoPlan:
    def plan(self, *_: Any) -> PlanningResult:
        return PlanningResult(Verdict.FAILED, message="no plan")


class Handle:
    """A goal's handle, which takes actionlib's lock when it is asked."""

    def __init__(self, lock: Any) -> None:
        self._lock = lock
        self.is_asked_by_planning = threading.Event()
        self.ended = threading.Event()

    def get_goal(self) -> AssignTaskGoal:
        return AssignTaskGoal(author="tests", goals="")

    def get_goal_id(self) -> GoalID:
        if threading.current_thread().name == "plan":
            self.is_asked_by_planning.set()
        with self._lock:
            return GoalID(id=str(id(self)))

    def set_accepted(self) -> None:
        pass

    def set_aborted(self, result: Any, text: str) -> None:
        self.ended.set()


def test_goal_may_arrive_while_another_ends() -> None:
    manager = TaskManager(NoPlan(), lambda call: None)  # type: ignore[arg-type]
    lock = threading.RLock()
    first, second = Handle(lock), Handle(lock)

    def give_goals() -> None:
        with lock:
            manager._on_goal(first)
            assert first.is_asked_by_planning.wait(10.0)
            manager._on_goal(second)

    giving = threading.Thread(target=give_goals, daemon=True)
    giving.start()
    giving.join(20.0)
    assert not giving.is_alive(), "the two locks are taken in different orders"
    assert first.ended.wait(10.0)
    assert second.ended.wait(10.0)
