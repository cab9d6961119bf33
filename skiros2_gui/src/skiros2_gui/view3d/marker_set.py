"""The markers of a scene, and which of them have changed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from skiros2_common.core.world_element import Element
from skiros2_gui.view3d.labels import place_labels
from skiros2_gui.view3d.markers import ElementMarker
from skiros2_world_model.core.changes import RESET, Change

_SCENE = "scene"


@dataclass
class MarkerUpdate:
    """What a view has to change.

    :param changed: markers that are new or have changed.
    :param removed: markers to delete.
    """

    changed: list[ElementMarker] = field(default_factory=list)
    removed: list[ElementMarker] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.changed or self.removed)


class ChangedElements:
    """Collects the ids of changed elements. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ids: set[str] = set()
        self._everything = True
        self._state = ""
        #: Set while `take` has something to return.
        self.waiting = threading.Event()
        self.waiting.set()

    def add(self, change: Change) -> None:
        """Adds a change. Changes come in order; after a gap every element counts as changed."""
        with self._lock:
            is_next = not self._state or change.prev_snapshot_id == self._state
            self._state = change.snapshot_id
            if change.action == RESET or not is_next or (not change.elements and not change.relations):
                self._everything = True
            elif change.context == _SCENE:
                self._ids.update(element.id for element in change.elements)
            if self._ids or self._everything:
                self.waiting.set()

    def add_ids(self, ids: Iterable[str]) -> None:
        """Marks elements as changed."""
        with self._lock:
            self._ids.update(ids)
            self.waiting.set()

    def take(self) -> set[str] | None:
        """Returns and clears the ids; None: every element may have changed."""
        with self._lock:
            ids, everything = self._ids, self._everything
            self._ids, self._everything = set(), False
            self.waiting.clear()
            return None if everything else ids

    def restore(self, ids: set[str] | None) -> None:
        """Puts back what `take` returned, after reading the elements failed."""
        with self._lock:
            if ids is None:
                self._everything = True
            else:
                self._ids |= ids
            self.waiting.set()


class MarkerSet:
    """The markers that a view shows. Used by one thread.

    :param make: returns the marker of an element, or None.
    """

    def __init__(self, make: Callable[[Element], ElementMarker | None]) -> None:
        self._make = make
        self._markers: dict[str, ElementMarker] = {}
        self._lifts: dict[str, float | None] = {}

    @property
    def all(self) -> Iterable[ElementMarker]:
        """All markers."""
        return self._markers.values()

    def get(self, eid: str) -> ElementMarker | None:
        """Returns the marker of an element, or None."""
        return self._markers.get(eid)

    def place_labels(self) -> MarkerUpdate:
        """Places the labels of all markers; changes of elements keep the places until the next call."""
        bare = {eid: replace(marker, lift=0.0) if marker.lift else marker for eid, marker in self._markers.items()}
        self._lifts = place_labels(bare)
        update = MarkerUpdate()
        for eid, lift in self._lifts.items():
            if self._markers[eid].lift != lift:
                self._markers[eid] = replace(bare[eid], lift=lift)
                update.changed.append(self._markers[eid])
        return update

    def _lifted(self, element: Element) -> ElementMarker | None:
        """Returns the marker of an element with its label in its place."""
        marker = self._make(element)
        lift = self._lifts.get(marker.id, 0.0) if marker is not None else 0.0
        return replace(marker, lift=lift) if marker is not None and lift != 0.0 else marker

    def replace_all(self, elements: Iterable[Element]) -> MarkerUpdate:
        """Replaces all markers with those of the given elements."""
        now = {marker.id: marker for element in elements if (marker := self._lifted(element)) is not None}
        before, self._markers = self._markers, now
        return MarkerUpdate(
            [marker for eid, marker in now.items() if before.get(eid) != marker],
            [marker for eid, marker in before.items() if eid not in now],
        )

    def replace(self, elements: dict[str, Element | None]) -> MarkerUpdate:
        """Replaces the markers of some elements, by id; None deletes the marker."""
        update = MarkerUpdate()
        for eid, element in elements.items():
            before = self._markers.get(eid)
            now = self._lifted(element) if element is not None else None
            if now is not None and now != before:
                self._markers[eid] = now
                update.changed.append(now)
            elif now is None and before is not None:
                del self._markers[eid]
                update.removed.append(before)
        return update
