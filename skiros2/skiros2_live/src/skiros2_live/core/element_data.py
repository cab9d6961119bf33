"""The world model as JSON data: elements and changes."""

from __future__ import annotations

from math import isfinite
from typing import Any

from skiros2_common.core.operations import REMOVE, Change
from skiros2_common.core.world_element import Element


def element_data(element: Element) -> dict[str, Any]:
    """Returns an element as JSON data; its relations are those from it to other elements."""
    relations = element.getRelations("-1") + (element.getRelations(element.id) if element.id else [])
    return {
        "id": element.id,
        "type": element.type,
        "label": element.label,
        "properties": {prop.key: [_plain(value) for value in prop.values] for prop in element.properties},
        "relations": sorted({(str(r["type"]), str(r["dst"])) for r in relations if isinstance(r["dst"], str)}),
    }


def change_data(change: Change) -> dict[str, Any]:
    """Returns a change as JSON data: the elements in their new state, and relations between other elements."""
    removed = change.action == REMOVE
    relations = [[r["src"], r["type"], r["dst"]] for r in change.relations]
    return {
        "revision": change.number,
        "author": change.author,
        "changed": [] if removed else [element_data(element) for element in change.elements],
        "removed": [element.id for element in change.elements] if removed else [],
        "related": [] if removed else relations,
        "unrelated": relations if removed else [],
    }


def _plain(value: Any) -> Any:
    """Returns a value as JSON has it: NaN and infinities are texts."""
    is_plain = isinstance(value, bool | int | str) or value is None or (isinstance(value, float) and isfinite(value))
    return value if is_plain else str(value)
