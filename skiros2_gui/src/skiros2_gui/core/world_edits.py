"""The user's own changes of the scene, and undo and redo of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from skiros2_common.core.errors import Refused
from skiros2_common.core.names import local_name
from skiros2_gui.core.world_undo import joined, undoing
from skiros2_world_model.core.changes import Outcome
from skiros2_world_model.core.history_entry import HistoryEntry
from skiros2_world_model.core.world_model_abstract_interface import WmConflict
from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

#: So many changes can be taken back.
MOST_KEPT = 100
#: So many own changes wait for the answer to their request.
_MOST_HEARD = 500
#: Changes of the same element that follow each other within this time are one (s).
_ONE_DRAG = 2.0
#: So often undo is tried when elements change under it.
_TRIES = 5


@dataclass
class Edit:
    """A change by the user.

    :param text: what it was, in words: "remove LargeBox-3".
    :param made: what it has made other.
    :param is_from_elsewhere: not made in this tab, but in another view of this window.
    """

    text: str
    made: HistoryEntry
    is_from_elsewhere: bool = False


@dataclass
class _Sent:
    """A request that was carried out, and that was not heard of yet in the changes of the scene."""

    text: str
    states: list[str]
    kept_by: list[Edit]


class Edits:
    """What was done by hand in this window, for undo and redo. Used by the Qt thread alone.

    What a change made is taken from the scene itself, as it is told of: with all that reasoners have added to it. So
    undo takes that back too, and redo is the undo of the undo.
    """

    def __init__(self) -> None:
        self.undone: list[Edit] = []
        self.done: list[Edit] = []
        self._heard: dict[str, HistoryEntry] = {}
        self._known: deque[str] = deque(maxlen=_MOST_HEARD)  # what was heard; a scene read anew has it told again
        self._sent: list[_Sent] = []

    @property
    def undo_text(self) -> str:
        """What undo would take back; "" when there is nothing."""
        return self.done[-1].text if self.done else ""

    @property
    def redo_text(self) -> str:
        """What redo would do again; "" when there is nothing."""
        return self.undone[-1].text if self.undone else ""

    @property
    def is_settled(self) -> bool:
        """Whether all that was sent has been heard of."""
        return not self._sent

    def sent(self, text: str, outcome: Outcome) -> None:
        """A change by the user was carried out."""
        self.undone.clear()
        self._await(text, outcome, self.done)

    def undid(self, edit: Edit, outcome: Outcome) -> None:
        """An edit of `done` was taken back."""
        if edit in self.done:
            self.done.remove(edit)
            self._await(edit.text, outcome, self.undone)

    def redid(self, edit: Edit, outcome: Outcome) -> None:
        """An edit of `undone` was done again."""
        if edit in self.undone:
            self.undone.remove(edit)
            self._await(edit.text, outcome, self.done)

    def heard(self, changes: Mapping[str, HistoryEntry]) -> None:
        """Changes of this window's author have come, by snapshot id."""
        self._heard.update((state, made) for state, made in changes.items() if state not in self._known)
        self._known.extend(changes)
        while len(self._heard) > _MOST_HEARD:
            del self._heard[next(iter(self._heard))]
        self._match()

    def take_others(self) -> None:
        """Nothing of this tab is under way: what was heard and not asked for here, was done elsewhere in the window.

        Changes of one element shortly after one another, as when it is dragged in rviz, are one edit.
        """
        awaited = {state for sent in self._sent for state in sent.states}
        for state in [state for state in self._heard if state not in awaited]:
            made = self._heard.pop(state)
            ids = {element.id for element in (*made.before, *made.after)}
            if not made:
                continue
            last = self.done[-1] if self.done else None
            text = f"change of {', '.join(sorted(map(local_name, ids))[:3])}"
            is_same = last is not None and last.is_from_elsewhere and last.text == text
            if last is not None and is_same and made.stamp - last.made.stamp < _ONE_DRAG:
                self.done[-1] = Edit(text, joined([last.made, made]), True)
            else:
                self.done.append(Edit(text, made, True))
                del self.done[:-MOST_KEPT]
            self.undone.clear()

    def forget(self) -> None:
        """The scene is another one: nothing can be taken back."""
        for kept in (self.done, self.undone, self._heard, self._sent):
            kept.clear()

    def _await(self, text: str, outcome: Outcome, kept_by: list[Edit]) -> None:
        states = [change.snapshot_id for change in outcome.changes]
        if states:
            self._sent.append(_Sent(text, states, kept_by))
            self._match()

    def _match(self) -> None:
        while (heard := next((i for i, sent in enumerate(self._sent) if self._is_heard(sent)), None)) is not None:
            sent = self._sent[heard]
            del self._sent[: heard + 1]  # of those before it nothing will be heard: the scene was read with them
            made = joined([self._heard.pop(state) for state in sent.states])
            if made:
                sent.kept_by.append(Edit(sent.text, made))
                del sent.kept_by[:-MOST_KEPT]

    def _is_heard(self, sent: _Sent) -> bool:
        return all(state in self._heard for state in sent.states)


def take_back(world: WorldModelAbstractInterface, edit: Edit, who: Callable[[str], str]) -> Outcome:
    """Undoes an edit of the scene. Blocks for the world model.

    :param who: as for `undoing`; called in this thread.
    :raises Refused: somebody has changed what it made.
    :raises WmException: the world model refuses, or does not answer.
    """
    for tried in range(_TRIES):
        operations = undoing(edit.made, world.find_element, who)
        if not operations:
            raise Refused("there is nothing left of it")
        try:
            return world.transact(operations)
        except WmConflict:
            if tried == _TRIES - 1:
                raise
            world.catch_up()
    raise AssertionError("unreachable")
