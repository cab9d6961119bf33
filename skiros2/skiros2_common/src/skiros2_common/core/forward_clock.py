"""The time of what a process observes: a wall clock that does not go back when it is set."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable


class ForwardClock:
    """Returns the wall clock's time (s since the epoch). Where that is set back, it continues from its last time.

    Thread-safe.
    """

    def __init__(self, wall: Callable[[], float] = time.time, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._wall, self._monotonic = wall, monotonic
        self._lock = threading.Lock()
        self._last, self._at = -math.inf, 0.0

    def __call__(self) -> float:
        with self._lock:
            at = self._monotonic()
            self._last, self._at = max(self._wall(), self._last + at - self._at), at
            return self._last


#: That of this process.
now = ForwardClock()
