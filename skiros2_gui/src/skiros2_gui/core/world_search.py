"""Finding elements by words of their ids, labels and values."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_common.core.names import id_order
from skiros2_world_model.core.scene import ElementRecord


class SearchTexts:
    """What the elements of a scene are found by: of each one text, made anew when the element is another."""

    def __init__(self) -> None:
        self._texts: dict[str, tuple[ElementRecord, str]] = {}

    def find(self, text: str, nodes: Iterable[ElementRecord]) -> list[str]:
        """Of some elements those that have all words of a text, in the order of their ids; none for no words."""
        words = text.lower().split()
        found = [node.id for node in nodes if all(map(self._text(node).__contains__, words))]
        return sorted(found, key=id_order) if words else []

    def forget(self, eid: str) -> None:
        """There is no such element any more."""
        self._texts.pop(eid, None)

    def _text(self, node: ElementRecord) -> str:
        known = self._texts.get(node.id)
        if known is None or known[0] is not node:
            values = (str(v) for prop in node.properties.values() for v in prop.values if isinstance(v, str))
            known = self._texts[node.id] = node, " ".join((node.id, node.label, *values)).lower()
        return known[1]
