"""Removes old jobs and audit entries while the gateway runs.

A clock that is set while the gateway runs makes nothing older or younger: the age of what this process writes is
measured by the monotonic clock.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque

from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import NONE, JobStore, Numbers

log = logging.getLogger(__name__)

#: The most time between two removals (s), and the time between the parts of one.
PERIOD, PAUSE = 3600.0, 0.05

_DAY = 86_400.0  # s


class Ages:
    """The ages at which data in a store are old.

    :param seconds: the age from which something is old.
    """

    def __init__(self, store: JobStore, seconds: float) -> None:
        self._store = store
        self._seconds = seconds
        self._begin = time.time() - time.monotonic()
        self._earlier = store.last_numbers()
        self._marks: deque[tuple[float, Numbers]] = deque()
        self._old = NONE

    def prune(self) -> int:
        """Removes some of what is old. Returns how much; 0: nothing is left to remove."""
        now = time.monotonic()
        while self._marks and self._marks[0][0] <= now - self._seconds:
            self._old = self._marks.popleft()[1]
        return self._store.prune(self._begin + now - self._seconds, self._earlier, self._old)

    def mark(self) -> None:
        """Notes what has been written by now."""
        self._marks.append((time.monotonic(), self._store.last_numbers()))


async def keep_days(store: JobStore, days: float) -> None:
    """Removes what is older, now and once an hour, or ten times in a shorter period, until it is cancelled.

    :param days: 0: nothing is removed.
    """
    if days <= 0.0:
        return
    ages = Ages(store, days * _DAY)
    while True:
        removed = 0
        try:
            ages.mark()
            while some := ages.prune():
                removed += some
                await asyncio.sleep(PAUSE)
        except StoreFailed as error:
            log.error("old jobs are not removed: %s", error)
        if removed:
            log.info("removed %s jobs and audit entries that were older than %g days", removed, days)
        await asyncio.sleep(min(PERIOD, days * _DAY / 10.0))
