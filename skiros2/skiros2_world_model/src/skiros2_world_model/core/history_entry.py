"""Entries of the history of a world model, the comparison of two scenes, and both as text."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import relation_dict
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
    :param before: the changed and removed elements in their old state, without relations.
    :param after: the changed and added elements in their new state, without relations.
    :param related: the added relations, as dicts.
    :param unrelated: the removed relations.
    :param stated: the added RDF statements of the ontologies or beside elements, as N-Triples.
    :param unstated: the removed RDF statements.
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
        """Whether anything changed."""
        return bool(self.before or self.after or self.related or self.unrelated or self.stated or self.unstated)

    def affects(self, names: Collection[str], dst: str = "") -> bool:
        """Whether an entry of a single element changes one of these properties or relations.

        :param dst: the object of the relation; "": any.
        """
        if any(r["type"] in names and dst in ("", r["dst"]) for r in (*self.related, *self.unrelated)):
            return True
        return any(_values(self.before, name) != _values(self.after, name) for name in names)

    def pairs(self) -> list[tuple[Element | None, Element | None]]:
        """The old and the new state of each element; None where the element does not exist."""
        before = {e.id: e for e in self.before}
        after = {e.id: e for e in self.after}
        return [(before.get(eid), after.get(eid)) for eid in {**before, **after}]


def _values(elements: list[Element], key: str) -> list[Any] | None:
    prop = elements[0]._props.get(key) if elements else None
    return None if prop is None else prop.values


def changed_lines(entry: HistoryEntry) -> list[str]:
    """Formats an entry, one change per line: `+` added, `-` removed, `~` changed."""
    lines: list[str] = []
    for before, after in entry.pairs():
        if before is None and after is not None:
            lines.append(f"+ {format_element(after)}  {summary(after)}".rstrip())
        elif after is None and before is not None:
            lines.append(f"- {format_element(before)}")
        elif before is not None and after is not None:
            lines += _changed(before, after)
    lines += [f"- {format_relation(r)}" for r in entry.unrelated] + [f"+ {format_relation(r)}" for r in entry.related]
    return lines + [f"- {text}" for text in entry.unstated] + [f"+ {text}" for text in entry.stated]


def difference(old: Iterable[Element], new: Iterable[Element]) -> HistoryEntry:
    """Compares the elements of two scenes and their outgoing relations.

    A number equals its text; a property without values equals a missing one.
    """
    before, after = ({e.id: e for e in elements} for elements in (old, new))
    entry = HistoryEntry(0, 0.0, "", "difference")
    for eid in sorted({*before, *after}):
        one, other = before.get(eid), after.get(eid)
        if one is None or other is None or _changed(one, other):
            entry.before += [one] if one is not None else []
            entry.after += [other] if other is not None else []
    relations = [_relations(elements.values()) for elements in (before, after)]
    entry.unrelated = [relation_dict(*r) for r in sorted(relations[0] - relations[1])]
    entry.related = [relation_dict(*r) for r in sorted(relations[1] - relations[0])]
    return entry


def _changed(before: Element, after: Element) -> list[str]:
    lines = []
    for name, one, other in (("type", before.type, after.type), ("label", before.label, after.label)):
        if one != other:
            lines.append(f"~ {after.id} {name}: {one or '(none)'} -> {other or '(none)'}")
    for key in sorted({*before._props, *after._props}):
        was, now = before._props.get(key), after._props.get(key)
        if not _same(was, now):
            lines.append(f"~ {after.id} {key}: {_text(was)} -> {_text(now)}")
    return lines


def _same(one: Property | None, other: Property | None) -> bool:
    values, others = (sorted(prop.values, key=str) if prop is not None else [] for prop in (one, other))
    return len(values) == len(others) and all(map(same_value, values, others))


def _text(prop: Property | None) -> str:
    return format_values(prop.values) if prop is not None and prop.values else "(none)"


def _relations(elements: Iterable[Element]) -> set[tuple[str, str, str]]:
    return {(e.id, r["type"], r["dst"]) for e in elements for r in e._rels if r["src"] == "-1"}
