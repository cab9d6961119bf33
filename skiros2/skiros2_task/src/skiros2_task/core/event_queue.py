"""The events of one thread, also at a later time."""

from __future__ import annotations

import heapq
import queue
import time
from collections.abc import Callable
from itertools import count

Event = Callable[[], None]


class EventQueue:
    """A queue of functions to call. Any thread puts events; one thread gets them."""

    def __init__(self) -> None:
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._later: list[tuple[float, int, Event]] = []  # a heap of times (s, monotonic)
        self._order = count()

    def put(self, event: Event | None) -> None:
        self._events.put(event)

    def put_later(self, seconds: float, event: Event) -> None:
        """Adds an event at a later time. Only the thread that gets the events calls it."""
        heapq.heappush(self._later, (time.monotonic() + seconds, next(self._order), event))

    def get(self) -> Event | None:
        """Waits for the next event."""
        while True:
            delay = self._later[0][0] - time.monotonic() if self._later else None
            if delay is not None and delay <= 0.0:
                return heapq.heappop(self._later)[2]
            try:
                return self._events.get(timeout=delay)
            except queue.Empty:
                continue
