"""Which elements of a cell a view has not shown yet."""

from __future__ import annotations

import asyncio
from typing import Any

from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import EntriesChanged


class ElementChanges:
    """Collects the changes of elements for one view; of several changes of an element it gets the last.

    To be used in the thread of the gateway's loop. All elements count as changed at first.
    """

    def __init__(self, document: CellDocument) -> None:
        self._elements = document.tables["elements"]
        self._known = set(self._elements)
        self._changed = set(self._elements)
        self._waiting = asyncio.Event()
        self._waiting.set()
        document.subscribe(EntriesChanged, self._on_change)

    async def take(self) -> dict[str, dict[str, Any] | None]:
        """Waits for changes. Returns the elements by id, as of `element_data`; None: it was removed."""
        await self._waiting.wait()
        self._waiting.clear()
        changed, self._changed = self._changed, set()
        return {eid: self._data(eid) for eid in changed}

    def all(self) -> dict[str, dict[str, Any] | None]:
        """Returns all elements, and those that were removed."""
        return {eid: self._data(eid) for eid in self._known | self._elements.keys()}

    def _data(self, eid: str) -> dict[str, Any] | None:
        element = self._elements.get(eid)
        return {key: value for key, value in element.items() if key != "marker"} if element is not None else None

    def _on_change(self, patch: EntriesChanged) -> None:
        if patch.table != "elements":
            return
        self._changed.update(patch.entries, self._known if patch.is_whole else ())
        self._known.update(patch.entries)
        self._waiting.set()
