"""Sends the user's changes of the scene to the world model, one at a time; undo and redo."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from skiros2_common.core.names import local_name
from skiros2_gui.app.window import Window
from skiros2_world_model.core.changes import Operation, Outcome
from skiros2_world_model.core.changeset import ChangeSet, merge

#: The job queue of the calls that change the world model.
QUEUE = "world"

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
    """The commands of this window that can be undone and redone.

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

    def on_reverted(self, command: UndoCommand, outcome: Outcome) -> None:
        """Moves a command that was undone or redone to the other side."""
        for source, target in ((self.done, self.undone), (self.undone, self.done)):
            if command in source:
                source.remove(command)
                self._add_pending(command.text, outcome, target)
                return

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
        for snapshot in [snapshot for snapshot in self._received if snapshot not in awaited]:
            change = self._received.pop(snapshot).effective()
            if not change:
                continue
            self.adopt(f"change of {', '.join(sorted(map(local_name, change.records))[:3])}", change)

    def adopt(self, text: str, change: ChangeSet) -> None:
        """Pushes a change that a skill has made for the user; successive ones with the same text are one command."""
        now, last = time.monotonic(), self.done[-1] if self.done else None
        if last is not None and last.is_external and last.text == text and now - last.time < _MERGE_PERIOD:
            self.done.pop()
            change = merge([last.change, change])
        self.done.append(UndoCommand(text, change.effective(), True, now))
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


class SceneEditor:
    """Sends changes and keeps the undo stack. Used by the Qt thread only; jobs make the blocking calls.

    :param on_undo_stack: called when the undo stack has changed.
    """

    def __init__(self, window: Window, on_undo_stack: Callable[[], None]) -> None:
        self.undo_stack = UndoStack()
        self._window = window
        self._on_undo_stack = on_undo_stack
        self._steps: deque[str] = deque()  # "undo" and "redo" that wait for running requests
        self._requests_running = 0

    def send(self, text: str, operations: Sequence[Operation], done: Callable[[Outcome], None] | None = None) -> None:
        """Sends a change as one request.

        :param text: what the user does, such as "remove LargeBox-3".
        :param done: called with the outcome.
        """
        world = self._window.system.world
        if world is None:
            self._window.problems.report(text, "there is no world model")
            return

        def on_outcome(outcome: Outcome) -> None:
            self.undo_stack.push(text, outcome)
            self._on_request_ended()
            if done is not None:
                done(outcome)

        self._run(lambda: world.transact(operations), on_outcome, text)

    def undo(self) -> None:
        """Undoes the last command, after all running requests have ended."""
        self._steps.append("undo")
        self._run_next_step()

    def redo(self) -> None:
        """Redoes the command undone last, after all running requests have ended."""
        self._steps.append("redo")
        self._run_next_step()

    def on_changes(self, changes: Mapping[str, ChangeSet]) -> None:
        """Takes published changes of this window's author, by snapshot id."""
        self.undo_stack.on_changes(changes)
        self._push_external()
        if changes:
            self._on_undo_stack()
        self._run_next_step()

    def adopt(self, text: str, change: ChangeSet) -> None:
        """Takes a change that a skill has made for the user into the undo stack."""
        self.undo_stack.adopt(text, change)
        self._on_undo_stack()

    def clear(self) -> None:
        """Discards the undo stack: another scene was loaded."""
        self._steps.clear()
        self.undo_stack.clear()
        self._on_undo_stack()

    def _run(self, call: Callable[[], Outcome], done: Callable[[Outcome], None], activity: str) -> None:
        def failed(error: Exception) -> None:
            self._steps.clear()
            self._on_request_ended()
            self._window.problems.report(activity, error)

        self._requests_running += 1
        self._window.jobs.run(call, done, failed, activity=activity, queue=QUEUE)

    def _on_request_ended(self) -> None:
        self._requests_running -= 1
        self._push_external()
        self._on_undo_stack()
        self._run_next_step()

    def _push_external(self) -> None:
        if not self._requests_running:
            self.undo_stack.push_external()

    def _run_next_step(self) -> None:
        """Starts the next undo or redo step, once the undo stack is complete."""
        if not self._steps or self._requests_running or not self.undo_stack.is_complete:
            return
        step, world = self._steps.popleft(), self._window.system.world
        commands = self.undo_stack.done if step == "undo" else self.undo_stack.undone
        if not commands or world is None:
            self._steps.clear()
            return
        command = commands[-1]

        def on_outcome(outcome: Outcome) -> None:
            self.undo_stack.on_reverted(command, outcome)
            self._on_request_ended()

        self._run(lambda: world.revert(command.change), on_outcome, f"{step}: {command.text}")
