"""Changes as text, and the difference of two scenes."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import relation_dict
from skiros2_world_model.core.history_entry import HistoryEntry
from skiros2_world_model.core.shown import shown_element, shown_relation, shown_values, summary


def changed_lines(entry: HistoryEntry) -> list[str]:
    """What an entry tells, a line each: `+` came, `-` went, `~` became other."""
    lines: list[str] = []
    for before, after in entry.pairs():
        if before is None and after is not None:
            lines.append(f"+ {shown_element(after)}  {summary(after)}".rstrip())
        elif after is None and before is not None:
            lines.append(f"- {shown_element(before)}")
        elif before is not None and after is not None:
            lines += _changed(before, after)
    lines += [f"- {shown_relation(r)}" for r in entry.unrelated] + [f"+ {shown_relation(r)}" for r in entry.related]
    return lines + [f"- {text}" for text in entry.unstated] + [f"+ {text}" for text in entry.stated]


def difference(old: Iterable[Element], new: Iterable[Element]) -> HistoryEntry:
    """What is other in the elements of one scene than in those of another, which have their outgoing relations.

    Numbers and their texts are the same; so are a property without values and none.
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
    return shown_values(prop.values) if prop is not None and prop.values else "(none)"


def _relations(elements: Iterable[Element]) -> set[tuple[str, str, str]]:
    return {(e.id, r["type"], r["dst"]) for e in elements for r in e._rels if r["src"] == "-1"}
