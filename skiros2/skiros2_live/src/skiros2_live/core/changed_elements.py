"""Which elements have changed, for a reader that reads them again from time to time."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from skiros2_common.core.operations import RESET, SCENE, Change
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort


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
            elif change.context == SCENE:
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

    @contextmanager
    def read(self, world: WorldModelPort) -> Iterator[tuple[dict[str, Element | None], bool]]:
        """Reads the changed elements: by id, None if removed; and whether they are the whole scene.

        After an exception of the reading, or of the caller's block, they count as changed again.
        """
        ids = self.take()
        try:
            if ids is None:
                yield {element.id: element for element in world.resolve_elements(Element())}, True
            else:
                yield {eid: world.find_element(eid) for eid in ids}, False
        except Exception:
            self._restore(ids)
            raise

    def _restore(self, ids: set[str] | None) -> None:
        with self._lock:
            if ids is None:
                self._everything = True
            else:
                self._ids |= ids
            self.waiting.set()
