"""Calls the code of skills, and lets another thread abandon a call that does not return."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeAlias, TypeVar

_T = TypeVar("_T")

EXECUTE_HOOK = "execute"


class Named(Protocol):
    """The owner of a hook: a skill run."""

    @property
    def name(self) -> str: ...


_Run = TypeVar("_Run", bound=Named)


class HookAbandoned(Exception):
    """Raised in the thread of an abandoned hook when the hook returns: this thread must no longer touch the tree."""


@dataclass(eq=False)
class HungHook(Generic[_Run]):
    """A hook that has not returned.

    :param hook: its name, or what else the engine does for the skill run.
    :param reason: why it was abandoned, for people.
    """

    run: _Run
    hook: str
    reason: str = ""

    @property
    def name(self) -> str:
        return f"{self.run.name}: {self.hook}"


Call: TypeAlias = "tuple[_Run, str] | _Run"


def _hung(call: Call[_Run]) -> HungHook[_Run]:
    return HungHook(*call) if isinstance(call, tuple) else HungHook(call, EXECUTE_HOOK)


class HookGuard(Generic[_Run]):
    """The hook that the ticking thread is calling, in a list of at most one entry: run and hook, or the run alone.

    The ticking thread appends the entry and pops it after the call. Another thread that pops it first abandons the
    hook. `list.pop` is atomic, so exactly one of them gets the entry.
    """

    def __init__(self) -> None:
        self.calls: list[Call[_Run]] = []

    @property
    def current(self) -> str:
        """The hook that is being called, "" when none is. Any thread."""
        calls = self.calls[-1:]
        return _hung(calls[0]).name if calls else ""

    def call(self, run: _Run, hook: str, function: Callable[..., _T], *args: object) -> _T:
        """Calls a function under the guard.

        :raises HookAbandoned: another thread has abandoned the call, whatever the function returns or raises.
        """
        calls = self.calls
        calls.append((run, hook))
        try:
            return function(*args)
        finally:
            try:
                calls.pop()
            except IndexError:
                raise HookAbandoned from None

    def abandon(self) -> HungHook[_Run] | None:
        """Abandons the hook that is being called; None when there is none.

        Called by another thread, which alone may use the tree afterwards.
        """
        try:
            hung = _hung(self.calls.pop())
        except IndexError:
            return None
        # The abandoned thread finds its own list empty; whoever ticks from now on has another one. It is replaced after
        # the pop: an empty list that is put back would hide the hook that the ticking thread calls meanwhile.
        self.calls = []
        return hung
