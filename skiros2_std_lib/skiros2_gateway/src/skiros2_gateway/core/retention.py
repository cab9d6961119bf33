"""Removes old jobs and audit entries while the gateway runs."""

from __future__ import annotations

import asyncio
import logging
import time

from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import JobStore

log = logging.getLogger(__name__)

#: The most time between two removals (s), and the time between the parts of one.
PERIOD, PAUSE = 3600.0, 0.05

_DAY = 86_400.0  # s


async def keep_days(store: JobStore, days: float) -> None:
    """Removes what is older, now and once an hour, or ten times in a shorter period, until it is cancelled.

    :param days: 0: nothing is removed.
    """
    while days > 0.0:
        removed = 0
        try:
            while some := store.prune(time.time() - days * _DAY):
                removed += some
                await asyncio.sleep(PAUSE)
        except StoreFailed as error:
            log.error("old jobs are not removed: %s", error)
        if removed:
            log.info("removed %s jobs and audit entries that were older than %g days", removed, days)
        await asyncio.sleep(min(PERIOD, days * _DAY / 10.0))
