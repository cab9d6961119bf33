"""The undo stack of the scene editor."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from skiros2_common.core.names import local_name
from skiros2_world_model.core.changes import Outcome
from skiros2_world_model.core.changeset import ChangeSet, merge

#: Commands kept on each side of the stack.
MAX_KEPT = 100
#: Changes kept while the response to their request is pending.
_MAX_RECEIVED = 500
#: External changes of the same elements within this time are merged into one command (s).
_MERGE_PERIOD = 2.0


@dataclass(frozen=True, eq=False)  # equal commands differ by their place in the stack
class UndoCommand:
    """A change that can be undone.

    :param text: what the user did, such as "remove LargeBox-3".
    :param change: what changed, reasoners' additions included.
    :param is_external: made by another view of this window (rviz), not by the tab.
    :param time: when it was received (s of a monotonic clock), if it is external.
    """

    text: str
    change: ChangeSet
    is_external: bool = False
    time: float = 0.0


@dataclass
class _PendingCommand:
    """A request that the world model has applied and whose changes have not been received yet.

    :param snapshots: the snapshot ids of its changes.
    :param target: the side of the stack it is pushed to.
    """

    text: str
    snapshots: list[str]
    target: list[UndoCommand]


class UndoStack:
    """The commands of this window that can be undone and redone. Used by the Qt thread only.

    A command stores the changes that the world model published for it, including those by reasoners. Undo reverts all
    of them, and redo reverts the undo.

    :ivar done: commands that can be undone, the latest last.
    :ivar undone: commands that can be redone, the latest last.
    """

    def __init__(self) -> None:
        self.undone: list[UndoCommand] = []
        self.done: list[UndoCommand] = []
        self._received: dict[str, ChangeSet] = {}
        self._known: deque[str] = deque(maxlen=_MAX_RECEIVED)  # a scene that is read again repeats its last changes
        self._pending: list[_PendingCommand] = []

    @property
    def undo_text(self) -> str:
        """The text of the next command to undo, or ""."""
        return self.done[-1].text if self.done else ""

    @property
    def redo_text(self) -> str:
        """The text of the next command to redo, or ""."""
        return self.undone[-1].text if self.undone else ""

    @property
    def is_complete(self) -> bool:
        """Whether the changes of all requests have been received."""
        return not self._pending

    def push(self, text: str, outcome: Outcome) -> None:
        """Pushes a request of the user that the world model has applied."""
        self.undone.clear()
        self._add_pending(text, outcome, self.done)

    def on_undone(self, command: UndoCommand, outcome: Outcome) -> None:
        """Moves a command of `done` to `undone`."""
        if command in self.done:
            self.done.remove(command)
            self._add_pending(command.text, outcome, self.undone)

    def on_redone(self, command: UndoCommand, outcome: Outcome) -> None:
        """Moves a command of `undone` to `done`."""
        if command in self.undone:
            self.undone.remove(command)
            self._add_pending(command.text, outcome, self.done)

    def on_changes(self, changes: Mapping[str, ChangeSet]) -> None:
        """Takes published changes of this window's author, by snapshot id."""
        self._received.update((snapshot, c) for snapshot, c in changes.items() if snapshot not in self._known)
        self._known.extend(changes)
        while len(self._received) > _MAX_RECEIVED:
            del self._received[next(iter(self._received))]
        self._match()

    def push_external(self) -> None:
        """Pushes the received changes that no request of the tab made; to be called while no request is running.

        Successive changes of the same elements, as from dragging in rviz, are merged into one command.
        """
        awaited = {snapshot for pending in self._pending for snapshot in pending.snapshots}
        now = time.monotonic()
        for snapshot in [snapshot for snapshot in self._received if snapshot not in awaited]:
            change = self._received.pop(snapshot).effective()
            if not change:
                continue
            last = self.done[-1] if self.done else None
            text = f"change of {', '.join(sorted(map(local_name, change.records))[:3])}"
            is_same = last is not None and last.is_external and last.text == text
            if last is not None and is_same and now - last.time < _MERGE_PERIOD:
                self.done[-1] = UndoCommand(text, merge([last.change, change]), True, now)
            else:
                self.done.append(UndoCommand(text, change, True, now))
                del self.done[:-MAX_KEPT]
            self.undone.clear()

    def clear(self) -> None:
        """Discards all commands: another scene was loaded."""
        for kept in (self.done, self.undone, self._received, self._pending):
            kept.clear()

    def _add_pending(self, text: str, outcome: Outcome, target: list[UndoCommand]) -> None:
        snapshots = [change.snapshot_id for change in outcome.changes]
        if snapshots:
            self._pending.append(_PendingCommand(text, snapshots, target))
            self._match()

    def _match(self) -> None:
        while (first := next((i for i, p in enumerate(self._pending) if self._is_received(p)), None)) is not None:
            pending = self._pending[first]
            del self._pending[: first + 1]  # the scene was read after the earlier ones: their changes will not come
            change = merge(self._received.pop(snapshot) for snapshot in pending.snapshots).effective()
            if change:
                pending.target.append(UndoCommand(pending.text, change))
                del pending.target[:-MAX_KEPT]

    def _is_received(self, pending: _PendingCommand) -> bool:
        return all(snapshot in self._received for snapshot in pending.snapshots)
