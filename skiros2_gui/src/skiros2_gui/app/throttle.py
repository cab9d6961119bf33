"""Limits the time spent on repeated work."""

from __future__ import annotations

import time
from collections.abc import Callable


class Throttle:
    """Keeps repeated work to a share of the time. For one thread.

    :param share: 0 to 1.
    """

    def __init__(self, share: float = 0.1, clock: Callable[[], float] = time.monotonic) -> None:
        self._share = share
        self._clock = clock
        self._began = self._ready_at = -1.0

    @property
    def is_ready(self) -> bool:
        """Whether the work may start again."""
        return self._clock() >= self._ready_at

    def begin(self) -> None:
        """The work starts."""
        self._began = self._clock()

    def end(self) -> None:
        """The work has ended."""
        now = self._clock()
        self._ready_at = now + (now - self._began) * (1.0 / self._share - 1.0)
