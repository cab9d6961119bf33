"""A step whose result is lost: its task may still run, beside that of a new plan."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy

from skiros2_common.core.errors import TimedOut, UnknownName
from skiros2_common.core.params import ParamHandler
from skiros2_task.core.plan import SkillCall, Step
from skiros2_task.ros.step_runner import ManagerStepRunner

NAME = "/robot"
STEP = Step(1, SkillCall(NAME, "Drive", "drive", ()), skill=None, ground=None)  # type: ignore[arg-type]  # not needed


class LostGoal:
    """A goal whose status is no longer received."""

    task = 7
    done = False
    cancelled = 0
    is_closed = False

    def wait(self, timeout: float) -> bool:
        raise TimedOut("no status")

    def cancel(self) -> None:
        self.cancelled += 1
        if self.is_closed:
            raise rospy.ROSException("publish() to a closed topic")


class Manager:
    name = NAME

    def __init__(self) -> None:
        self.goal = LostGoal()

    def run(self, *_: Any, **__: Any) -> LostGoal:
        return self.goal

    def get_skill(self, label: str) -> ParamHandler:
        raise UnknownName(label)


@pytest.mark.parametrize("is_closed", [False, True], ids=["heard", "gone"])
def test_step_that_fails_without_a_result_is_cancelled(is_closed: bool) -> None:
    runner: Any = object.__new__(ManagerStepRunner)  # without a node
    manager = Manager()
    manager.goal.is_closed = is_closed
    runner._discovered, runner._agents, runner._runs = threading.Condition(), {NAME: manager}, defaultdict(set)
    ended = threading.Event()
    results: list[tuple[bool, int]] = []

    def end(succeeded: bool, message: str, explanations: Any) -> None:
        results.append((succeeded, manager.goal.cancelled))
        ended.set()

    runner.start(STEP, end)
    assert ended.wait(10.0)
    assert results == [(False, 1)], "cancelled before the next plan is made"
