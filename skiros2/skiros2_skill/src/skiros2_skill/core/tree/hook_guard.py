"""The note of which hook is being called, and how a hook that does not return is left behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

_T = TypeVar("_T")

#: What is noted of the hook that is called most.
EXECUTE_HOOK = "execute"


class LeftBehind(Exception):
    """A hook returns after its task was taken away from the thread: nothing of the tick may go on."""


@dataclass(eq=False)
class Stuck:
    """A hook that has not returned.

    :param what: the hook, or what else is done for the node.
    :param reason: what became of it, in words.
    """

    node: Any
    what: str
    reason: str = ""

    @property
    def place(self) -> str:
        return f"{self.node.type}-{self.node.label}: {self.what}"


class Inside:
    """A place for one note. The thread that ticks puts it there and takes it away again, or another one does: then the
    hook is left behind. The one whose `pop` finds the note has won (lists are atomic in that)."""

    def __init__(self) -> None:
        self.notes: list[tuple[Any, str]] = []

    @property
    def place(self) -> str:
        """The hook that is being called, "" when none is. Any thread."""
        notes = self.notes[-1:]
        return Stuck(*notes[0]).place if notes else ""

    def enter(self, node: Any, what: str) -> list[tuple[Any, str]]:
        """Notes a hook before it is called. What it returns is for `leave`."""
        notes = self.notes
        notes.append((node, what))
        return notes

    @staticmethod
    def leave(notes: list[tuple[Any, str]]) -> None:
        """Takes the note away after the hook.

        :raises LeftBehind: somebody else has.
        """
        try:
            notes.pop()
        except IndexError:
            raise LeftBehind from None

    def call(self, node: Any, what: str, function: Callable[..., _T], *args: Any) -> _T:
        """Calls a function with the note set.

        :raises LeftBehind: as `leave`, whatever the function raised.
        """
        notes = self.enter(node, what)
        try:
            return function(*args)
        finally:
            self.leave(notes)

    def take(self) -> Stuck | None:
        """Takes the note away from the hook that is being called; None when there is none.

        Called by another thread, which has the tree for itself then.
        """
        notes, self.notes = self.notes, []
        try:
            return Stuck(*notes.pop())
        except IndexError:
            self.notes = notes
            return None
