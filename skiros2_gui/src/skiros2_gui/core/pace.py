"""How often something is done that takes longer the larger the scene is."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pace:
    """Keeps what is done again and again to a share of the time. For one thread.

    :param share: of the time that it may take.
    """

    def __init__(self, share: float = 0.1, clock: Callable[[], float] = time.monotonic) -> None:
        self._share = share
        self._clock = clock
        self._began = self._rests_until = -1.0

    @property
    def is_rested(self) -> bool:
        """Whether it may be done again."""
        return self._clock() >= self._rests_until

    def begin(self) -> None:
        """It is begun."""
        self._began = self._clock()

    def end(self) -> None:
        """It is done."""
        now = self._clock()
        self._rests_until = now + (now - self._began) * (1.0 / self._share - 1.0)
