"""Sending the user's changes of the scene, one after the other, and undo and redo of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from skiros2_gui.core.window import Window
from skiros2_gui.core.world_edits import Edit, Edits, take_back
from skiros2_world_model.core.changes import Operation, Outcome
from skiros2_world_model.core.history_entry import HistoryEntry

#: Calls that change the world model are made in their order.
LANE = "world"


class SceneEditor:
    """What is under way of the user's changes. Used by the Qt thread alone; jobs do what takes time.

    :param who: tells who has changed an element last, and when; called by jobs.
    :param changed: called when other edits can be undone or done again than before.
    """

    def __init__(self, window: Window, who: Callable[[str], str], changed: Callable[[], None]) -> None:
        self.edits = Edits()
        self._window = window
        self._who = who
        self._changed = changed
        self._steps: deque[Callable[[], None]] = deque()  # of undo and redo, that are still to be made
        self._under_way = 0  # requests that have not ended

    def send(self, text: str, operations: Sequence[Operation], done: Callable[[Outcome], None] | None = None) -> None:
        """Has a change carried out.

        :param text: what it is, in words.
        :param done: called with what came of it.
        """
        world = self._window.system.world
        if world is None:
            self._window.problems.tell(text, "there is no world model")
            return

        def carried_out(outcome: Outcome) -> None:
            self.edits.sent(text, outcome)
            self._ended()
            if done is not None:
                done(outcome)

        self._run(lambda: world.transact(operations), carried_out, text)

    def undo(self) -> None:
        """Takes the last change back, once all before it have come to their end."""
        self._steps.append(self._undo)
        self._go_on()

    def redo(self) -> None:
        """Does again what was taken back last, likewise."""
        self._steps.append(self._redo)
        self._go_on()

    def heard(self, changes: Mapping[str, HistoryEntry]) -> None:
        """Changes of this window's author have come, by snapshot id."""
        self.edits.heard(changes)
        self._take_others()
        if changes:
            self._changed()
        self._go_on()

    def forget(self) -> None:
        """The scene is another one: nothing can be taken back."""
        self._steps.clear()
        self.edits.forget()
        self._changed()

    def _run(self, call: Callable[[], Outcome], done: Callable[[Outcome], None], what: str) -> None:
        def failed(error: Exception) -> None:
            self._steps.clear()
            self._ended()
            self._window.problems.tell(what, error)

        self._under_way += 1
        self._window.jobs.run(call, done, failed, what=what, lane=LANE)

    def _ended(self) -> None:
        """A request has ended."""
        self._under_way -= 1
        self._take_others()
        self._changed()
        self._go_on()

    def _take_others(self) -> None:
        if not self._under_way:
            self.edits.take_others()

    def _go_on(self) -> None:
        """Makes the next step of undo and redo, when what it is about is known."""
        if self._steps and not self._under_way and self.edits.is_settled:
            self._steps.popleft()()

    def _undo(self) -> None:
        self._take_back(self.edits.done[-1:], "undo", self.edits.undid)

    def _redo(self) -> None:
        self._take_back(self.edits.undone[-1:], "redo", self.edits.redid)

    def _take_back(self, edits: Sequence[Edit], what: str, told: Callable[[Edit, Outcome], None]) -> None:
        world = self._window.system.world
        if not edits or world is None:
            self._steps.clear()
            return
        edit = edits[0]

        def carried_out(outcome: Outcome) -> None:
            told(edit, outcome)
            self._ended()

        self._run(lambda: take_back(world, edit, self._who), carried_out, f"{what}: {edit.text}")
