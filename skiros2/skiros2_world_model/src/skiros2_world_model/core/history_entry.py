"""Entries of the history of a world model, the comparison of two scenes, and both as text."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import relation_dict
from skiros2_world_model.core.changeset import ChangeSet, ElementRecord, Pair, Relation
from skiros2_world_model.core.formatting import format_element, format_relation, format_values, summary

#: A point of the history: the number of a change (int), or a time (float, s since the epoch).
Point = int | float


@dataclass
class HistoryEntry:
    """The changes of a context in one request, or between two points of its history.

    An entry is false when nothing changed.

    :param number: the number of the first change of the request, or of the last request between the points.
    :param stamp: the time of that change (s since the epoch).
    :param action: `change`, `load FILE`, `ontology`, `start` (a start without recovery) or `difference`.
    """

    number: int
    stamp: float
    author: str
    action: str
    changes: ChangeSet = field(default_factory=ChangeSet)

    def __bool__(self) -> bool:
        """Whether anything changed."""
        return bool(self.changes)

    @property
    def before(self) -> list[Element]:
        """The changed and removed elements in their old state, with those outgoing relations that were removed."""
        return _elements((before for before, _ in self.changes.records.values()), self.unrelated)

    @property
    def after(self) -> list[Element]:
        """The changed and added elements in their new state, with those outgoing relations that were added."""
        return _elements((after for _, after in self.changes.records.values()), self.related)

    @property
    def related(self) -> list[RelationDict]:
        """The added relations, as dicts."""
        return [relation_dict(*relation) for relation, added in self.changes.relations.items() if added]

    @property
    def unrelated(self) -> list[RelationDict]:
        """The removed relations, as dicts."""
        return [relation_dict(*relation) for relation, added in self.changes.relations.items() if not added]

    @property
    def stated(self) -> list[str]:
        """The added RDF statements of the ontologies or beside elements, as N-Triples."""
        return [statement for statement, added in self.changes.statements.items() if added]

    @property
    def unstated(self) -> list[str]:
        """The removed RDF statements."""
        return [statement for statement, added in self.changes.statements.items() if not added]

    def pairs(self) -> list[tuple[Element | None, Element | None]]:
        """The old and the new state of each element; None where the element does not exist."""
        before, after = ({e.id: e for e in elements} for elements in (self.before, self.after))
        return [(before.get(eid), after.get(eid)) for eid in self.changes.records]

    def affects(self, names: Collection[str], dst: str = "") -> bool:
        """Whether an entry of a single element changes one of these properties or relations.

        :param dst: the object of the relation; "": any.
        """
        if any(pred in names and dst in ("", obj) for _, pred, obj in self.changes.relations):
            return True
        pairs = self.changes.records.values()
        return any(_values(before, name) != _values(after, name) for before, after in pairs for name in names)


def _elements(records: Iterable[ElementRecord | None], relations: Iterable[RelationDict]) -> list[Element]:
    elements = {record.id: _element(record) for record in records if record is not None}
    for relation in relations:
        if relation["src"] in elements:
            elements[relation["src"]].addRelation("-1", relation["type"], relation["dst"])
    return list(elements.values())


def _element(record: ElementRecord) -> Element:
    """A copy, as made by hand: writing it restores this state."""
    element = Element(record.type, record.label, record.id)
    for key, prop in record.properties.items():
        element._put(key, prop.clone())
    return element


def _values(record: ElementRecord | None, key: str) -> list[Any] | None:
    prop = record.properties.get(key) if record is not None else None
    return None if prop is None else prop.values


def changed_lines(entry: HistoryEntry) -> list[str]:
    """Formats an entry, one change per line: `+` added, `-` removed, `~` changed."""
    lines: list[str] = []
    for before, after in sorted(entry.changes.records.values(), key=lambda pair: pair[0] is None):  # added ones last
        if before is None and after is not None:
            element = after.element()
            lines.append(f"+ {format_element(element)}  {summary(element)}".rstrip())
        elif after is None and before is not None:
            lines.append(f"- {format_element(before.element())}")
        elif before is not None and after is not None:
            lines += _changed(before, after)
    lines += [f"- {format_relation(r)}" for r in entry.unrelated] + [f"+ {format_relation(r)}" for r in entry.related]
    return lines + [f"- {text}" for text in entry.unstated] + [f"+ {text}" for text in entry.stated]


def difference(old: Iterable[Element], new: Iterable[Element]) -> HistoryEntry:
    """Compares the elements of two scenes and their outgoing relations.

    A number equals its text; a property without values equals a missing one.
    """
    old, new = list(old), list(new)
    before, after = ({e.id: ElementRecord(e.id, e.type, e.label, e._props) for e in es} for es in (old, new))
    changes = ChangeSet()
    for eid in sorted({*before, *after}):
        pair: Pair = before.get(eid), after.get(eid)
        if pair[0] is None or pair[1] is None or _changed(pair[0], pair[1]):
            changes.records[eid] = pair
    one, other = _relations(old), _relations(new)
    changes.relations = dict.fromkeys(sorted(one - other), False) | dict.fromkeys(sorted(other - one), True)
    return HistoryEntry(0, 0.0, "", "difference", changes)


def _changed(before: ElementRecord, after: ElementRecord) -> list[str]:
    lines = []
    for name, one, other in (("type", before.type, after.type), ("label", before.label, after.label)):
        if one != other:
            lines.append(f"~ {after.id} {name}: {one or '(none)'} -> {other or '(none)'}")
    for key in sorted({*before.properties, *after.properties}):
        was, now = before.properties.get(key), after.properties.get(key)
        if not _same(was, now):
            lines.append(f"~ {after.id} {key}: {_text(was)} -> {_text(now)}")
    return lines


def _same(one: Property | None, other: Property | None) -> bool:
    values, others = (sorted(prop.values, key=str) if prop is not None else [] for prop in (one, other))
    return len(values) == len(others) and all(map(same_value, values, others))


def _text(prop: Property | None) -> str:
    return format_values(prop.values) if prop is not None and prop.values else "(none)"


def _relations(elements: Iterable[Element]) -> set[Relation]:
    return {(e.id, r["type"], r["dst"]) for e in elements for r in e._rels if r["src"] == "-1"}
