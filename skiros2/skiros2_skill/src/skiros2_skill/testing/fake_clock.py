"""A clock that a test advances."""

from __future__ import annotations

import itertools
import sys
import threading
import time
from contextlib import ExitStack
from types import TracebackType
from typing import ClassVar

from skiros2_skill.testing.faults import replaced


class FakeClock:
    """A clock that only moves when it is advanced.

    Inside `with FakeClock() as clock:` it replaces `time.time`, `time.monotonic`, `time.sleep` and, if rospy is
    imported, `rospy.Time.now` and `rospy.get_time`, except in code with `from time import ...`. `sleep` advances the
    clock in the thread that entered it; in other threads it waits until the clock is advanced far enough.
    `time.monotonic` increases by a nanosecond at each call: no two results are equal.

    Clocks of one thread may be nested.

    :param now: the initial time (s).
    :raises RuntimeError: on entry, a clock of another thread is active: its exit would stop the time for ever.
    """

    _active: ClassVar[list[FakeClock]] = []

    def __init__(self, now: float = 1000.0) -> None:
        self._now = now
        self._calls = itertools.count()
        self._change = threading.Condition()
        self._owner = threading.current_thread()
        self._replaced = ExitStack()
        self._running = False

    @property
    def now(self) -> float:
        """The time (s)."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Advances the clock.

        :raises ValueError: `seconds` is negative.
        """
        if seconds < 0:
            raise ValueError(f"time does not go back, got {seconds} s")
        with self._change:
            self._now += seconds
            self._change.notify_all()

    def sleep(self, seconds: float) -> None:
        """Replaces `time.sleep`."""
        if threading.current_thread() is self._owner:
            self.advance(seconds)
            return
        with self._change:
            deadline = self._now + seconds
            self._change.wait_for(lambda: self._now >= deadline or not self._running)

    def __enter__(self) -> FakeClock:
        self._owner = threading.current_thread()
        if self._active and self._active[-1]._owner is not self._owner:
            raise RuntimeError(f"the fake clock of thread {self._active[-1]._owner.name} is active")
        self._active.append(self)
        self._running = True
        for name, fake in (("time", lambda: self._now), ("monotonic", self._monotonic), ("sleep", self.sleep)):
            self._replaced.enter_context(replaced(time, name, fake))
        if (rospy := sys.modules.get("rospy")) is not None:
            # Without a node rospy has no time; with wall time it calls `time.time`.
            self._replaced.callback(rospy.rostime.set_rostime_initialized, rospy.rostime.is_rostime_initialized())
            rospy.rostime.set_rostime_initialized(True)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._replaced.close()
        self._active.remove(self)
        with self._change:
            self._running = False
            self._change.notify_all()

    def _monotonic(self) -> float:
        return self._now + 1e-9 * next(self._calls)
