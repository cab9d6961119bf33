"""What the history of a world model tells."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.world_element import Element, RelationDict

#: A point of the history: the number of a change (int), or a time (float, s since the epoch).
Point = int | float


@dataclass
class HistoryEntry:
    """What became of a context in one request, or between two points of its history.

    :param number: of the first change of the request, or of the last request between the points.
    :param stamp: when that was (s since the epoch).
    :param action: `change`, `load FILE`, `ontology`, `start` (a world model that did not go on from its journal), or
        `difference`.
    :param before: the elements that were changed or removed, as they were; without relations.
    :param after: the elements that were changed or added, as they became; without relations.
    :param related: the relations that came, as dicts.
    :param unrelated: the relations that went.
    :param stated: other RDF statements that came, as N-Triples: of the ontologies, and of what is beside elements.
    :param unstated: those that went.
    """

    number: int
    stamp: float
    author: str
    action: str
    before: list[Element] = field(default_factory=list)
    after: list[Element] = field(default_factory=list)
    related: list[RelationDict] = field(default_factory=list)
    unrelated: list[RelationDict] = field(default_factory=list)
    stated: list[str] = field(default_factory=list)
    unstated: list[str] = field(default_factory=list)

    def __bool__(self) -> bool:
        """Whether anything is other."""
        return bool(self.before or self.after or self.related or self.unrelated or self.stated or self.unstated)

    def touches(self, names: Collection[str], dst: str = "") -> bool:
        """Whether an entry of one element is about one of some properties or relations.

        :param dst: the object of the relation; "" any.
        """
        if any(r["type"] in names and dst in ("", r["dst"]) for r in (*self.related, *self.unrelated)):
            return True
        return any(_values(self.before, name) != _values(self.after, name) for name in names)

    def pairs(self) -> list[tuple[Element | None, Element | None]]:
        """The elements, each as it was and as it became; None when it was not there."""
        before = {e.id: e for e in self.before}
        after = {e.id: e for e in self.after}
        return [(before.get(eid), after.get(eid)) for eid in {**before, **after}]


def _values(elements: list[Element], key: str) -> list[Any] | None:
    prop = elements[0]._props.get(key) if elements else None
    return None if prop is None else prop.values
