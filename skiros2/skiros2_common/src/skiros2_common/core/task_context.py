"""The task whose skill starts, for resources that outlive a skill: they tell a later skill of the same task from one of
another task."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_current: ContextVar[object] = ContextVar("task", default=None)


def current_task() -> object:
    """Returns an object that stands for the task whose skill's `onStart` this thread calls; None outside of one."""
    return _current.get()


@contextmanager
def starting_in(task: object) -> Iterator[None]:
    """Makes this the current task inside the `with` block."""
    token = _current.set(task)
    try:
        yield
    finally:
        _current.reset(token)
