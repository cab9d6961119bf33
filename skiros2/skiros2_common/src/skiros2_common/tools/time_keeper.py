"""Stopwatches."""

from __future__ import annotations

import logging
import time
from typing import Self

log = logging.getLogger(__name__)


class Timer:
    """Times parts of a program and logs them. `with Timer("x") as t` starts the first part.

    :param name: prefix of each line.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._start = self._last = time.monotonic()

    def __enter__(self) -> Self:
        self.reset()
        return self

    def __exit__(self, *_: object) -> None:
        """Does nothing."""

    def reset(self) -> None:
        self._start = self._last = time.monotonic()

    def tic(self, desc: str | None = None) -> None:
        """Starts a part."""
        self._last = time.monotonic()
        if desc:
            log.info("[%s] %s", self._name, desc)

    def toc(self, desc: str | None = None) -> float:
        """Ends a part: logs and returns the time since `tic` (s)."""
        passed = time.monotonic() - self._last
        log.info("[%s] %s: %.4f s", self._name, desc or "done", passed)
        return passed


class TimeKeeper:
    """Averages the times between `tic` and `toc`, or of `with` blocks (s)."""

    def __init__(self) -> None:
        self.reset()

    def __enter__(self) -> Self:
        self.tic()
        return self

    def __exit__(self, *_: object) -> None:
        self.toc()

    def reset(self) -> None:
        self._start = time.monotonic()
        self._tic: float | None = None
        self._last = 0.0
        self._total = 0.0
        self._count = 0

    def time_from_start(self) -> float:
        return time.monotonic() - self._start

    def tic(self) -> None:
        self._tic = time.monotonic()

    def toc(self) -> float:
        """The time since `tic` (s); 0.0 without one."""
        if self._tic is None:
            return 0.0
        self._last = time.monotonic() - self._tic
        self._tic = None
        self._total += self._last
        self._count += 1
        return self._last

    def get_avg_time(self) -> float | None:
        """The average (s); None before the first `toc`."""
        return self._total / self._count if self._count else None

    def get_last(self) -> float:
        return self._last


class TimeKeepers:
    """Several `TimeKeeper`s by name."""

    def __init__(self) -> None:
        self._keepers: dict[str, TimeKeeper] = {}

    def __getitem__(self, name: str) -> TimeKeeper:
        return self._keepers.setdefault(name, TimeKeeper())

    def printAvgTimings(self) -> str:
        """Logs and returns `name: average s`, a line each."""
        averages = ((name, keeper.get_avg_time()) for name, keeper in self._keepers.items())
        text = "\n".join(f"{name}: {'-' if s is None else f'{s:.6f} s'}" for name, s in averages)
        log.info("%s", text)
        return text
