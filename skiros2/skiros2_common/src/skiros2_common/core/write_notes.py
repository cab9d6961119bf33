"""Notes the writes to the world model that a thread requests, also those that change nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from skiros2_common.core.operations import Add, Apply, Expect, Instantiate, Operation, Relate, Remove, Update

_note: ContextVar[Callable[[str], None] | None] = ContextVar("note of writes", default=None)


@contextmanager
def noting_writes(note: Callable[[str], None] | None) -> Iterator[None]:
    """Calls `note` with each write of this thread inside the `with` block; None: with no write."""
    token = _note.set(note)
    try:
        yield
    finally:
        _note.reset(token)


def note_write(operations: Sequence[Operation] = (), unchanged: Sequence[str] = ()) -> None:
    """Notes a write.

    :param operations: the request; none if there is nothing to write.
    :param unchanged: the ids of elements that were to be written, without operations.
    """
    note = _note.get()
    if note is not None:
        texts = [_text(each) for each in operations if not isinstance(each, Expect)]
        note(", ".join([*texts, *(f"update {eid}" for eid in unchanged)]))


def _text(operation: Operation) -> str:
    if isinstance(operation, Add | Update):
        element = operation.element
        return f"update {element.id}" if isinstance(operation, Update) else f"add {element.type}"
    if isinstance(operation, Instantiate):
        return f"add {operation.uri}"
    if isinstance(operation, Relate):
        fact = f"{operation.src} {operation.pred} {operation.dst}"
        return f"relate {fact}" if operation.value else f"no longer relate {fact}"
    if isinstance(operation, Apply):
        return "apply a change set"
    return f"{'remove' if isinstance(operation, Remove) else 'update'} {operation.id}"
