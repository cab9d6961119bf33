"""Sends the user's changes of the scene to the world model, one at a time; undo and redo."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from skiros2_gui.app.window import Window
from skiros2_gui.world.undo_stack import UndoCommand, UndoStack
from skiros2_world_model.core.changes import Operation, Outcome
from skiros2_world_model.core.changeset import ChangeSet

#: The job queue of the calls that change the world model.
QUEUE = "world"


class SceneEditor:
    """Sends changes and keeps the undo stack. Used by the Qt thread only; jobs make the blocking calls.

    :param on_undo_stack: called when the undo stack has changed.
    """

    def __init__(self, window: Window, on_undo_stack: Callable[[], None]) -> None:
        self.undo_stack = UndoStack()
        self._window = window
        self._on_undo_stack = on_undo_stack
        self._steps: deque[Callable[[], None]] = deque()  # undo and redo steps that wait for running requests
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
        self._steps.append(self._undo)
        self._run_next_step()

    def redo(self) -> None:
        """Redoes the command undone last, after all running requests have ended."""
        self._steps.append(self._redo)
        self._run_next_step()

    def on_changes(self, changes: Mapping[str, ChangeSet]) -> None:
        """Takes published changes of this window's author, by snapshot id."""
        self.undo_stack.on_changes(changes)
        self._push_external()
        if changes:
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
        self._push_external()
        self._on_undo_stack()
        self._run_next_step()

    def _push_external(self) -> None:
        if not self._requests_running:
            self.undo_stack.push_external()

    def _run_next_step(self) -> None:
        """Starts the next undo or redo step, once the undo stack is complete."""
        if self._steps and not self._requests_running and self.undo_stack.is_complete:
            self._steps.popleft()()

    def _undo(self) -> None:
        self._revert(self.undo_stack.done[-1:], "undo", self.undo_stack.on_undone)

    def _redo(self) -> None:
        self._revert(self.undo_stack.undone[-1:], "redo", self.undo_stack.on_redone)

    def _revert(
        self, commands: Sequence[UndoCommand], action: str, on_reverted: Callable[[UndoCommand, Outcome], None]
    ) -> None:
        world = self._window.system.world
        if not commands or world is None:
            self._steps.clear()
            return
        command = commands[0]

        def on_outcome(outcome: Outcome) -> None:
            on_reverted(command, outcome)
            self._on_request_ended()

        self._run(lambda: world.revert(command.change), on_outcome, f"{action}: {command.text}")
