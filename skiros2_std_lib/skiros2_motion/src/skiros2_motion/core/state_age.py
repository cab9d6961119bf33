"""Detects that a driver no longer sends its state.

The age is measured by the arm's clock and by the wall clock. Simulated time stands still with its simulator: when this
one has died, only wall time shows it. A paused simulator sends the states of its arms again each half second of wall
time: it is paused, not dead.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from skiros2_motion.core.compliant_arm import STALE

#: Time without a state by the wall clock, whatever the arm's clock shows (s). Longer than `STALE`: a simulator may be
#: slow, or load a model.
SILENT = 2.0
#: Time for which the state has to stay out of date (s of wall time). A process that was held up, as on a busy machine,
#: may read the clock before the states that have arrived meanwhile.
CONFIRMATION = 0.2


class StateAge:
    """The age of the last state. `receive` and `overdue` may be called by different threads.

    :param clock: the arm's clock (s), simulated time in a simulation.
    :param wall_clock: monotonic (s).
    """

    def __init__(self, clock: Callable[[], float], wall_clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._wall_clock = clock, wall_clock
        self._received_at, self._received_wall = clock(), wall_clock()
        self._suspected: float | None = None  # since when it has been found out of date, by the wall clock

    @property
    def seconds(self) -> float:
        """The time since the last state, by the arm's clock (s)."""
        return self._clock() - self._received_at

    def receive(self) -> None:
        """A state was received."""
        self._received_at, self._received_wall, self._suspected = self._clock(), self._wall_clock(), None

    def overdue(self) -> float:
        """Returns for how long a driver has been silent (s), or 0.0 if its state is up to date. For each tick."""
        now = self._wall_clock()
        seconds, wall, suspected = self.seconds, now - self._received_wall, self._suspected
        if seconds <= STALE and wall <= SILENT:
            self._suspected = None
            return 0.0
        if suspected is None:
            self._suspected = suspected = now
        return max(seconds, wall) if now - suspected > CONFIRMATION else 0.0
