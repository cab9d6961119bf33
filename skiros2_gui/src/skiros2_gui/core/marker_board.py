"""Which elements a 3D view has to be told of anew: only what has changed since it was told last."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from skiros2_common.core.world_element import Element
from skiros2_gui.core.markers import Shown
from skiros2_world_model.core.changes import RESET, Change

_SCENE = "scene"


@dataclass
class Difference:
    """What a view has to be told.

    :param put: elements that are new or others than before.
    :param gone: elements that are not shown any more, as they were.
    """

    put: list[Shown] = field(default_factory=list)
    gone: list[Shown] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.put or self.gone)


class ChangedElements:
    """The ids of elements that have changed, gathered from the changes of a scene. Safe to use from all threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ids: set[str] = set()
        self._everything = True
        self._state = ""
        #: Set while there is something to take.
        self.waiting = threading.Event()
        self.waiting.set()

    def note(self, change: Change) -> None:
        """Notes a change, in the order in which they are told; a gap before it counts as everything."""
        with self._lock:
            is_next = not self._state or change.prev_snapshot_id == self._state
            self._state = change.snapshot_id
            if change.action == RESET or not is_next or (not change.elements and not change.relations):
                self._everything = True
            elif change.context == _SCENE:
                self._ids.update(element.id for element in change.elements)
            if self._ids or self._everything:
                self.waiting.set()

    def note_ids(self, ids: Iterable[str]) -> None:
        """Somebody wants to be told of these elements again."""
        with self._lock:
            self._ids.update(ids)
            self.waiting.set()

    def take(self) -> set[str] | None:
        """The ids since this was asked last; None: all there are."""
        with self._lock:
            ids, everything = self._ids, self._everything
            self._ids, self._everything = set(), False
            self.waiting.clear()
            return None if everything else ids

    def give_back(self, ids: set[str] | None) -> None:
        """What was taken could not be read."""
        with self._lock:
            if ids is None:
                self._everything = True
            else:
                self._ids |= ids
            self.waiting.set()


class MarkerBoard:
    """What a view shows. Used by one thread.

    :param showing: what is shown of an element; None: nothing.
    """

    def __init__(self, showing: Callable[[Element], Shown | None]) -> None:
        self._showing = showing
        self._shown: dict[str, Shown] = {}

    @property
    def shown(self) -> Iterable[Shown]:
        """Everything that the view shows."""
        return self._shown.values()

    def get(self, eid: str) -> Shown | None:
        """What is shown of an element, None when nothing is."""
        return self._shown.get(eid)

    def replace_all(self, elements: Iterable[Element]) -> Difference:
        """The scene has these elements and no others."""
        now = {shown.id: shown for element in elements if (shown := self._showing(element)) is not None}
        before, self._shown = self._shown, now
        return Difference(
            [shown for eid, shown in now.items() if before.get(eid) != shown],
            [shown for eid, shown in before.items() if eid not in now],
        )

    def replace(self, elements: dict[str, Element | None]) -> Difference:
        """Some elements, by id, are as given; None: there is no such element any more."""
        difference = Difference()
        for eid, element in elements.items():
            before = self._shown.get(eid)
            now = self._showing(element) if element is not None else None
            if now is not None and now != before:
                self._shown[eid] = now
                difference.put.append(now)
            elif now is None and before is not None:
                del self._shown[eid]
                difference.gone.append(before)
        return difference
