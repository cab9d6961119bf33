"""Time that passes when a test says so."""

from __future__ import annotations

import itertools
import sys
import threading
import time
from contextlib import ExitStack
from types import TracebackType

from skiros2_skill.testing.replace import replaced


class FakeClock:
    """A clock that stands still until it is told to go on.

    While it is entered (`with FakeClock() as clock:`) it is what `time.time`, `time.monotonic`, `time.sleep` and, when
    rospy is imported already, `rospy.Time.now` and `rospy.get_time` go by; not for code that has said
    `from time import ...`. `sleep` lets the time pass in the thread that entered the clock; other threads sleep until
    the clock has come so far. `time.monotonic` is a nanosecond later at each look: no two looks are at the same time.

    :param now: where it starts (s).
    """

    def __init__(self, now: float = 1000.0) -> None:
        self._now = now
        self._looks = itertools.count()
        self._change = threading.Condition()
        self._owner = threading.current_thread()
        self._replaced = ExitStack()
        self._running = False

    @property
    def now(self) -> float:
        """s."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Lets time pass.

        :raises ValueError: it would go back.
        """
        if seconds < 0:
            raise ValueError(f"time does not go back, got {seconds} s")
        with self._change:
            self._now += seconds
            self._change.notify_all()

    def sleep(self, seconds: float) -> None:
        """What `time.sleep` does meanwhile."""
        if threading.current_thread() is self._owner:
            self.advance(seconds)
            return
        with self._change:
            end = self._now + seconds
            self._change.wait_for(lambda: self._now >= end or not self._running)

    def __enter__(self) -> FakeClock:
        self._owner = threading.current_thread()
        self._running = True
        for name, fake in (("time", lambda: self._now), ("monotonic", self._look), ("sleep", self.sleep)):
            self._replaced.enter_context(replaced(time, name, fake))
        if (rospy := sys.modules.get("rospy")) is not None:
            # Without a node it has no time at all; with wall time, which it has then, it asks `time.time`.
            self._replaced.callback(rospy.rostime.set_rostime_initialized, rospy.rostime.is_rostime_initialized())
            rospy.rostime.set_rostime_initialized(True)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._replaced.close()
        with self._change:
            self._running = False
            self._change.notify_all()

    def _look(self) -> float:
        return self._now + 1e-9 * next(self._looks)
