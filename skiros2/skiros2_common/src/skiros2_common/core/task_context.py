"""The task whose skill starts, or the goal of which that task is a step, for resources that outlive a skill: a later
skill of the same task or goal is known from one of another."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_current: ContextVar[object] = ContextVar("task", default=None)


def current_task() -> object:
    """Returns what stands for the task whose skill's `onStart` this thread calls, equal for the tasks of one goal; None
    outside of one."""
    return _current.get()


@contextmanager
def starting_in(task: object) -> Iterator[None]:
    """Makes this the current task inside the `with` block."""
    token = _current.set(task)
    try:
        yield
    finally:
        _current.reset(token)
