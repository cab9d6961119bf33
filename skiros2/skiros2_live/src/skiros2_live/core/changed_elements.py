"""Which elements have changed, for a reader that reads them again from time to time."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from skiros2_common.core.operations import RESET, Change

_SCENE = "scene"


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
