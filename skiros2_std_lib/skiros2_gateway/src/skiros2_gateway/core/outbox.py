"""The goals of jobs that are loaded, until the jobs are on the disk: no goal is sent before."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from skiros2_gateway.core.cell import Goal
from skiros2_gateway.core.store import JobStore

log = logging.getLogger(__name__)

#: The time after which a disk that refuses is tried again (s).
_RETRY = 1.0


class Outbox:
    """To be used in the thread of the gateway's loop."""

    def __init__(self, store: JobStore) -> None:
        self._store = store
        self._goals: dict[str, Goal] = {}

    def __contains__(self, job_id: str) -> bool:
        return job_id in self._goals

    def send(self, goal: Goal, start: Callable[[Goal], None]) -> None:
        """Sends a goal as soon as what was written is on the disk, unless it is discarded before."""
        self._goals[goal.id] = goal

        def on_disk(synced: asyncio.Future[None]) -> None:
            if goal.id not in self._goals:
                return
            if (error := synced.exception()) is None:
                start(self._goals.pop(goal.id))
            else:
                log.error("job %s does not start yet: %s", goal.id, error)
                asyncio.get_running_loop().call_later(_RETRY, attempt)

        def attempt() -> None:
            if goal.id in self._goals:
                self._store.request_sync().add_done_callback(on_disk)

        attempt()

    def discard(self, job_id: str) -> None:
        """Has a goal not sent."""
        self._goals.pop(job_id, None)

    def clear(self) -> None:
        """Has no goal sent."""
        self._goals.clear()
