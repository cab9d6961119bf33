"""The last values of a signal, reduced to what a plot can show."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import NDArray

#: The longest time that is kept (s).
LONGEST = 30.0

#: Values within this time are drawn as one stroke from the minimum to the maximum (s): no peak is lost.
STROKE = 0.01

#: Without a message for this time the line is interrupted (s); longer for signals with a lower rate.
GAP = 0.5

#: A gap is also longer than this multiple of the usual time between two messages.
_GAP_FACTOR = 3.0

#: Times (s since the epoch) and values.
Line = tuple[NDArray[np.float64], NDArray[np.float64]]

_CAPACITY = int(1.2 * LONGEST / STROKE)


class SignalTrace:
    """The values of a signal in the last `LONGEST` seconds. Thread-safe.

    :ivar problem: why the last message has no value; "" if it has one.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._strokes = np.empty((_CAPACITY, 3))  # a ring: time of the first value, minimum, maximum
        self._count = 0
        self._began = -math.inf  # of the newest stroke
        self._least = self._greatest = math.nan
        self._last = -math.inf
        self._value = math.nan
        self.problem = ""

    def add(self, value: float, stamp: float, problem: str = "") -> None:
        """Adds a value.

        :param value: NaN is drawn as a gap.
        :param stamp: when it arrived (s since the epoch); not less than that of the value before.
        :param problem: why there is no value; "" if there is one.
        """
        with self._lock:
            self._last, self._value, self.problem = stamp, value, problem
            if stamp - self._began < STROKE and (value != value) == (self._least != self._least):
                self._least, self._greatest = min(self._least, value), max(self._greatest, value)
            else:
                self._began, self._least, self._greatest = stamp, value, value
                self._count += 1
            self._strokes[(self._count - 1) % _CAPACITY] = self._began, self._least, self._greatest

    @property
    def last(self) -> tuple[float, float]:
        """The last value and when it arrived (s since the epoch); NaN and -inf before the first one."""
        with self._lock:
            return self._value, self._last

    def line(self, begin: float, end: float) -> Line:
        """Returns times (s since the epoch) and values of a line to draw, with NaN at gaps.

        :param begin, end: the times of the first and last value (s since the epoch).
        """
        with self._lock:
            kept = min(self._count, _CAPACITY)
            first = (self._count - kept) % _CAPACITY
            strokes = np.roll(self._strokes, -first, axis=0)[:kept] if first else self._strokes[:kept].copy()
        strokes = strokes[(strokes[:, 0] >= begin) & (strokes[:, 0] <= end)]
        if not len(strokes):
            return np.empty(0), np.empty(0)
        steps = np.diff(strokes[:, 0])
        gap = max(GAP, _GAP_FACTOR * float(np.median(steps))) if len(steps) else GAP
        ends = np.flatnonzero(steps > gap)
        breaks = np.column_stack((strokes[ends, 0] + 1e-6, np.full((len(ends), 2), np.nan)))
        strokes = np.insert(strokes, ends + 1, breaks, axis=0)
        return np.repeat(strokes[:, 0], 2), strokes[:, 1:].reshape(-1)
