"""Calls of the platform's services in threads, each with a time limit that its thread has as the deadline."""

from __future__ import annotations

import asyncio
import contextvars
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import rospy

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_gateway.core.deadline import check_deadline, remaining, set_deadline

T = TypeVar("T")

#: How long a call may take, and one that plans (s).
_TIMEOUT, _PLAN_TIMEOUT = 10.0, 120.0
#: Calls at once, and those that plan: these take nothing from the others.
_THREADS, _PLAN_THREADS = 16, 4


class BlockingCalls:
    """To be used in the thread of a loop. Call `close` at the end."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(_THREADS, "cell")
        self._planners = ThreadPoolExecutor(_PLAN_THREADS, "plan")

    def close(self) -> None:
        for threads in (self._threads, self._planners):
            threads.shutdown(wait=False, cancel_futures=True)

    async def run(self, call: Callable[..., T], *arguments: Any, timeout: float = _TIMEOUT) -> T:
        """Runs a blocking call. A call that waits for a thread until its time is over is not started.

        :raises TimedOut: it takes longer; it continues in its thread.
        """
        return await self._run(self._threads, timeout, call, *arguments)

    async def plan(self, call: Callable[[], T]) -> T:
        """Runs a blocking call that plans."""
        return await self._run(self._planners, _PLAN_TIMEOUT, call)

    async def _run(self, threads: ThreadPoolExecutor, timeout: float, call: Callable[..., T], *arguments: Any) -> T:
        timeout = max(0.0, min(timeout, remaining()))
        context = contextvars.copy_context()
        context.run(set_deadline, time.monotonic() + timeout)

        def run() -> T:
            check_deadline()
            return call(*arguments)

        future = asyncio.get_running_loop().run_in_executor(threads, context.run, run)
        try:
            return await asyncio.wait_for(asyncio.shield(future), timeout)
        except TimeoutError:
            raise TimedOut(f"the cell has not answered within {timeout:g} s") from None
        except rospy.ServiceException as error:
            raise Refused(str(error)) from error
