"""Notes the times that a thread reads of a clock, or replaces them by recorded ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_read: ContextVar[Callable[[float], float] | None] = ContextVar("reader of the clock", default=None)


@contextmanager
def reading_clock(read: Callable[[float], float]) -> Iterator[None]:
    """Calls `read` with each time (s) that this thread reads inside the `with` block; code gets what it returns."""
    token = _read.set(read)
    try:
        yield
    finally:
        _read.reset(token)


def time_read(now: float) -> float:
    """Returns the time (s) that code gets which reads the clock at `now`."""
    read = _read.get()
    return now if read is None else read(now)
