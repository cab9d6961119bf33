"""Starts of goals that need the task manager before they are sent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_gateway.core.cell import Ending, Goal
from skiros2_gateway.ros import goal_starts
from skiros2_gateway.ros.goal_starts import GoalStarts


class TaskManager:
    """Answers after some calls; notes what becomes of goals."""

    def __init__(self, silences: int = 0, error: Exception | None = None) -> None:
        self.silences, self.error = silences, error
        self.asked = asyncio.Event()
        self.sent: list[str] = []
        self.ends: list[tuple[str, str, str]] = []
        self.starts = GoalStarts(lambda goal: self.sent.append(goal.id), self, self.call, self.plan)  # type: ignore[arg-type]

    async def call(self, _: Callable[..., Any], goal_id: str, on_restart: str) -> None:
        self.asked.set()
        await asyncio.sleep(0.0)
        self.silences -= 1
        if self.silences >= 0:
            raise TimedOut("the service does not answer")
        if self.error is not None:
            raise self.error

    async def plan(self, text: str, quality: str) -> dict[str, Any]:
        return {"plan": [{"robot": "/other"}]}

    def goal_ended(self, goal_id: str, ending: Ending) -> None:
        self.ends.append((goal_id, ending.outcome, ending.message))


GOAL = Goal("a", "(goal)", on_restart="continue")


@pytest.fixture(autouse=True)
def no_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goal_starts, "_RETRY_DELAY", 0.0)


async def _settled(condition: Callable[[], Any]) -> None:
    while not condition():
        await asyncio.sleep(0.0)


def test_goal_waits_for_a_silent_task_manager() -> None:
    async def run() -> None:
        manager = TaskManager(silences=3)
        manager.starts.start(GOAL)
        await _settled(lambda: manager.sent)
        assert manager.sent == ["a"] and not manager.ends

    asyncio.run(run())


def test_goal_that_is_cancelled_while_it_waits_is_not_sent() -> None:
    async def run() -> None:
        manager = TaskManager(silences=1000)
        manager.starts.start(GOAL)
        await manager.asked.wait()
        assert manager.starts.stop("a") and not manager.starts.stop("a")
        await _settled(lambda: manager.ends)
        manager.silences = 0
        await asyncio.sleep(0.05)
        assert manager.ends == [("a", "cancelled", "cancelled before its start")] and not manager.sent

    asyncio.run(run())


def test_goal_that_the_task_manager_refuses_fails_with_the_reason() -> None:
    async def run() -> None:
        manager = TaskManager(error=Refused("no such goal"))
        manager.starts.start(GOAL)
        await _settled(lambda: manager.ends)
        assert manager.ends == [("a", "failed", "planning: no such goal")] and not manager.sent

    asyncio.run(run())


def test_goal_whose_plan_uses_other_robots_fails() -> None:
    async def run() -> None:
        manager = TaskManager()
        manager.starts.start(Goal("a", "(goal)", robots=("/arm",)))
        await _settled(lambda: manager.ends)
        assert manager.ends == [("a", "failed", "the plan uses /other, allowed are /arm")]

    asyncio.run(run())


def test_goal_without_conditions_is_sent_at_once() -> None:
    async def run() -> None:
        manager = TaskManager()
        manager.starts.start(Goal("a", "(goal)"))
        assert manager.sent == ["a"]

    asyncio.run(run())
