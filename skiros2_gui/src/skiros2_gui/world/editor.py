"""Sends the user's changes of the scene to the world model, one at a time; undo and redo."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from skiros2_common.core.changeset import ChangeSet, merge
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.names import local_name
from skiros2_common.core.operations import Change, Operation, Outcome
from skiros2_gui.app.window import Window
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.world_model_client import WorldModelClient

#: The job queue of the calls that change the world model.
QUEUE = "world"

#: Commands kept on each side of the stack.
MAX_KEPT = 100
#: Changes kept while the response to their request is pending.
_MAX_RECEIVED = 500
#: External changes of the same elements within this time are merged into one command (s).
_MERGE_PERIOD = 2.0
#: The time for the published change of an edit to arrive (s). Then it is taken from the scene, which is read again.
TIMEOUT = 3.0


@dataclass(frozen=True, eq=False)  # equal commands differ by their place in the stack
class UndoCommand:
    """A change that can be undone.

    :param text: what the user did, such as "remove LargeBox-3".
    :param change: what changed, reasoners' additions included.
    :param is_external: made by another view of this window (rviz), not by the tab.
    :param time: when it was received (s of a monotonic clock), if it is external.
    :param numbers: of its first and last change, if the window did not receive them one by one. Then `change` may
        include what others have changed meanwhile; the world model's journal has the exact change.
    """

    text: str
    change: ChangeSet
    is_external: bool = False
    time: float = 0.0
    numbers: tuple[int, int] | None = None


@dataclass(eq=False)
class _PendingCommand:
    """A request that the world model has applied and whose changes have not been received yet.

    :param changes: those in the response.
    :param target: the side of the stack it is pushed to.
    :param since: when the response came (s of a monotonic clock).
    :param before: the scene before the first read that may contain the changes; None without such a read.
    :param is_contained: the scene was read with the changes: those not received yet will not come.
    """

    text: str
    changes: list[Change]
    target: list[UndoCommand]
    since: float
    before: Scene | None = None
    is_contained: bool = False

    @property
    def last(self) -> int:
        """The number of the last change."""
        return self.changes[-1].number


class UndoStack:
    """The commands of this window that can be undone and redone.

    A command stores the changes that the world model published for it, including those by reasoners. Undo reverts all
    of them, and redo reverts the undo.

    :param clock: monotonic (s).
    :ivar done: commands that can be undone, the latest last.
    :ivar undone: commands that can be redone, the latest last.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.undone: list[UndoCommand] = []
        self.done: list[UndoCommand] = []
        self._received: dict[str, ChangeSet] = {}
        self._known: deque[str] = deque(maxlen=_MAX_RECEIVED)  # a scene that is read again repeats its last changes
        self._pending: list[_PendingCommand] = []
        self._before: Scene | None = None  # before the first read during the running requests
        self._read_number = 0
        self._being_read: list[_PendingCommand] = []

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

    @property
    def is_overdue(self) -> bool:
        """Whether the changes of a request have not been received in time: read the scene."""
        return bool(self._pending) and self._clock() - self._pending[0].since > TIMEOUT

    def begin_read(self) -> None:
        """The scene is going to be read; it will contain all requests that the world model has applied."""
        self._being_read = list(self._pending)

    def end_read(self, before: Scene | None, number: int, is_editing: bool) -> None:
        """Takes the changes that the scene contains from it, as they may not be received.

        :param before: the scene as known before, which the stack may change.
        :param number: of the last change of an element in the new scene.
        :param is_editing: whether requests are running, which the new scene may contain, too.
        """
        self._read_number = number
        if not is_editing:
            self._before = None
        elif self._before is None:
            self._before = before
        for pending in self._pending:
            if pending.before is None:
                pending.before = before
            if pending in self._being_read or pending.last <= number:
                pending.is_contained = True
        self._match()

    def end_requests(self) -> None:
        """No request is running."""
        self._before = None

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
        awaited = {change.snapshot_id for pending in self._pending for change in pending.changes}
        for snapshot in [snapshot for snapshot in self._received if snapshot not in awaited]:
            change = self._received.pop(snapshot).effective()
            if not change:
                continue
            self.adopt(f"change of {', '.join(sorted(map(local_name, change.records))[:3])}", change)

    def adopt(self, text: str, change: ChangeSet) -> None:
        """Pushes a change that a skill has made for the user; successive ones with the same text are one command."""
        now, last = self._clock(), self.done[-1] if self.done else None
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
        self._before = None

    def _add_pending(self, text: str, outcome: Outcome, target: list[UndoCommand]) -> None:
        if not outcome.changes:
            return
        pending = _PendingCommand(text, outcome.changes, target, self._clock(), self._before)
        pending.is_contained = self._before is not None and pending.last <= self._read_number
        self._pending.append(pending)
        self._match()

    def _match(self) -> None:
        """Pushes the pending commands whose changes are known, in the order of their requests."""
        while self._pending and (self._pending[0].is_contained or self._is_received(self._pending[0])):
            pending = self._pending.pop(0)
            command = self._received_command(pending) if pending.before is None else self._derived_command(pending)
            if command.change:
                pending.target.append(command)
                del pending.target[:-MAX_KEPT]

    def _is_received(self, pending: _PendingCommand) -> bool:
        return all(change.snapshot_id in self._received for change in pending.changes)

    def _received_command(self, pending: _PendingCommand) -> UndoCommand:
        received = (self._received.pop(change.snapshot_id, ChangeSet()) for change in pending.changes)
        return UndoCommand(pending.text, merge(received).effective())

    def _derived_command(self, pending: _PendingCommand) -> UndoCommand:
        """Returns the command of changes that were read with the scene: those from the scene before to the response."""
        before, change_set = pending.before or Scene(), ChangeSet()
        for change in pending.changes:
            received = self._received.pop(change.snapshot_id, None)
            change_set.extend(received or apply_change(before, change))
            self._known.append(change.snapshot_id)  # the change may still be received
        numbers = pending.changes[0].number, pending.last
        return UndoCommand(pending.text, change_set.effective(), numbers=numbers)


def recorded_change(world: WorldModelClient, command: UndoCommand) -> ChangeSet:
    """Returns the change of a command, without what others have changed meanwhile if there is a journal. Blocks."""
    if command.numbers is None:
        return command.change
    first, last = command.numbers
    try:
        entries = world.history(since=first - 1, until=last)
    except SkirosError:  # no journal, or it does not reach back
        return command.change
    return merge(entry.changes for entry in entries).effective() or command.change


class SceneEditor:
    """Sends changes and keeps the undo stack. Used by the Qt thread only; jobs make the blocking calls.

    :param on_undo_stack: called when the undo stack has changed.
    :param clock: monotonic (s).
    """

    def __init__(self, window: Window, on_undo_stack: Callable[[], None], clock: Callable[[], float]) -> None:
        self.undo_stack = UndoStack(clock)
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

    def begin_read(self) -> None:
        """The scene is going to be read."""
        self.undo_stack.begin_read()

    def end_read(self, before: Scene | None, number: int) -> None:
        """The scene was read; see `UndoStack.end_read`."""
        self.undo_stack.end_read(before, number, self._requests_running > 0)
        self._on_undo_stack()
        self._run_next_step()

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
        if not self._requests_running:
            self.undo_stack.end_requests()
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

        self._run(lambda: world.revert(recorded_change(world, command)), on_outcome, f"{step}: {command.text}")
