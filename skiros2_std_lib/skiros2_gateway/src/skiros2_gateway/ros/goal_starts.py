"""Starts goals: what the task manager has to know before, and what it cannot check itself."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Any

from skiros2_common.core.errors import SkirosError, TimedOut
from skiros2_gateway.core.cell import Ending, Goal, GoalListener
from skiros2_gateway.ros.goals import SILENCE, set_on_restart
from skiros2_msgs.msg import AchieveResult

log = logging.getLogger(__name__)

#: The delay before a silent task manager is asked again (s).
_RETRY_DELAY = 1.0


class GoalStarts:
    """In the thread of the gateway's loop.

    :param send: sends a goal.
    :param in_thread: runs a blocking call; see `BlockingCalls.run`.
    :param plan: returns the plan of a goal and its quality, as JSON data.
    """

    def __init__(
        self,
        send: Callable[[Goal], None],
        listener: GoalListener,
        in_thread: Callable[..., Awaitable[Any]],
        plan: Callable[[str, str], Awaitable[dict[str, Any]]],
    ) -> None:
        self._send = send
        self._listener = listener
        self._in_thread = in_thread
        self._plan = plan
        self._starting: dict[str, asyncio.Task[None]] = {}

    def close(self) -> None:
        for task in self._starting.values():
            task.cancel()

    def start(self, goal: Goal) -> None:
        """Sends a goal, or reports its end."""
        if goal.on_restart or _is_restricted(goal):
            self._starting[goal.id] = asyncio.create_task(self._prepare(goal))
        else:
            self._send(goal)

    def stop(self, goal_id: str) -> bool:
        """Cancels a goal that is not sent yet. Returns whether it was one."""
        task = self._starting.pop(goal_id, None)
        if task is None:
            return False
        task.cancel()
        ending = Ending(AchieveResult.CANCELLED, "cancelled before its start")
        asyncio.get_running_loop().call_soon(self._listener.goal_ended, goal_id, ending)
        return True

    async def _prepare(self, goal: Goal) -> None:
        try:
            if goal.on_restart:
                await self._set_on_restart(goal)
            reason = await self._other_robots(goal) if _is_restricted(goal) else ""
        except Exception as error:
            if not isinstance(error, SkirosError):
                log.exception("planning job %s", goal.id)
            reason = f"planning: {error}"
        self._starting.pop(goal.id, None)
        if reason:
            self._listener.goal_ended(goal.id, Ending(AchieveResult.FAILED, reason))
        else:
            self._send(goal)

    async def _set_on_restart(self, goal: Goal) -> None:
        """Waits as long for a silent task manager as a goal that was sent."""
        loop = asyncio.get_running_loop()
        end = loop.time() + SILENCE
        while True:
            try:
                await self._in_thread(set_on_restart, goal.id, goal.on_restart)
                return
            except TimedOut as error:
                if loop.time() > end:
                    raise
                log.warning("job %s waits: %s", goal.id, error)
            await asyncio.sleep(_RETRY_DELAY)

    async def _other_robots(self, goal: Goal) -> str:
        """Returns which robots its plan uses that are not allowed; "" for none."""
        plan = await self._plan(goal.text, goal.quality)
        others = sorted({step["robot"] for step in plan["plan"]} - set(goal.robots))
        return f"the plan uses {', '.join(others)}, allowed are {', '.join(goal.robots)}" if others else ""


def _is_restricted(goal: Goal) -> bool:
    """Whether the goal has allowed robots, and is not a plan, which was checked before."""
    return bool(goal.robots) and goal.plan is None
