"""Reverts changes of the scene.

A change is a `HistoryEntry`. The operations that revert it restore the previous values in one request. If one of these
values was changed again, the revert is refused with the value and its author. Other changes of the elements are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Set
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_common.core.names import local_name
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, ElementChanges
from skiros2_world_model.core.changes import Add, Change, Expect, Operation, Patch, Remove, relation_dict
from skiros2_world_model.core.formatting import format_values
from skiros2_world_model.core.history_entry import HistoryEntry
from skiros2_world_model.core.scene import ElementRecord

_Relation = tuple[str, str, str]


def revert_operations(
    entry: HistoryEntry, find: Callable[[str], Element | None], who: Callable[[str], str]
) -> list[Operation]:
    """Returns the operations that revert a change; they conflict if an element changes meanwhile.

    :param find: returns an element of the current scene, with its relations in both directions.
    :param who: returns who changed an element last and when, such as "vision at 14:05:03"; "" if unknown.
    :raises Refused: something was changed again; the message says what.
    """
    return _Revert(entry, find, who).operations()


def merge_entries(entries: Iterable[HistoryEntry]) -> HistoryEntry:
    """Merges successive changes into one, from the state before the first to that after the last."""
    first: dict[str, Element | None] = {}
    last: dict[str, Element | None] = {}
    relations: dict[_Relation, list[bool]] = {}
    whole = HistoryEntry(0, 0.0, "", "change")
    for entry in entries:
        whole.number, whole.stamp, whole.author = entry.number, entry.stamp, entry.author
        for was, now in entry.pairs():
            eid = _either(was, now).id
            first.setdefault(eid, was)
            last[eid] = now
        for relations_changed, is_there in ((entry.unrelated, False), (entry.related, True)):
            for r in relations_changed:
                relations.setdefault(_ends(r), [not is_there, is_there])[1] = is_there
    whole.before = [e for e in first.values() if e is not None]
    whole.after = [e for e in last.values() if e is not None]
    whole.related = [relation_dict(*r) for r, (before, after) in relations.items() if after and not before]
    whole.unrelated = [relation_dict(*r) for r, (before, after) in relations.items() if before and not after]
    return whole


class _Revert:
    def __init__(self, entry: HistoryEntry, find: Callable[[str], Element | None], who: Callable[[str], str]) -> None:
        self._entry = entry
        self._who = who
        ids = [_either(*pair).id for pair in entry.pairs()]
        ends = [r[side] for r in (*entry.related, *entry.unrelated) for side in ("src", "dst")]
        self._elements = {eid: find(eid) for eid in dict.fromkeys([*ids, *ends])}
        self._recreated = {was.id: f"{i}" for i, (was, now) in enumerate(entry.pairs()) if was and not now}
        self._to_remove = {now.id for was, now in entry.pairs() if now and not was}

    def operations(self) -> list[Operation]:
        adds: list[Operation] = []
        patches: dict[str, ElementChanges] = {}
        for was, now in self._entry.pairs():
            if was is None and now is not None:
                self._check_added(now)
            elif now is None and was is not None:
                self._check_removed(was)
                copy = Element(was.type, was.label, was.id)
                copy._props = dict(was._props)
                adds.append(Add(copy, self._recreated[was.id]))
            elif was is not None and now is not None:
                patches[was.id] = self._content_as(was, now)
        for r in self._entry.related:
            self._check_relation(_ends(r), True)
            if r["src"] not in self._to_remove and r["dst"] not in self._to_remove:
                patches.setdefault(r["src"], ElementChanges()).removed_relations.append(_own(r, r["dst"]))
        relations: list[Operation] = []
        for r in self._entry.unrelated:
            self._check_relation(_ends(r), False)
            dst = f"#{self._recreated[r['dst']]}" if r["dst"] in self._recreated else r["dst"]
            if r["src"] in self._recreated:
                add = next(a for a in adds if isinstance(a, Add) and a.element.id == r["src"])
                assert isinstance(add, Add)
                add.element._rels = [*add.element._rels, _own(r, dst)]
            else:
                patches.setdefault(r["src"], ElementChanges()).added_relations.append(_own(r, dst))
        changed = [*patches, *self._to_remove]
        expected = [Expect(eid, e.version) for eid in changed if (e := self._elements.get(eid)) is not None]
        removals = [Remove(eid, recursive=False) for eid in self._to_remove]
        written = [Patch(eid, changes) for eid, changes in patches.items() if changes]
        return [*expected, *adds, *written, *relations, *removals]

    # -- checks that nothing was changed again ----------------------------------------------------------------

    def _check_added(self, now: Element) -> None:
        current = self._current(now)
        self._check_content(current, now, {*now._props, *current._props})
        expected = {_ends(r) for r in self._entry.related}
        for r in current._rels:
            src, dst = (current.id if r[side] == "-1" else r[side] for side in ("src", "dst"))
            if (src, r["type"], dst) not in expected:
                self._refuse(current.id, f"relation added: {src} {local_name(r['type'])} {dst}")

    def _check_removed(self, was: Element) -> None:
        if self._elements[was.id] is not None:
            self._refuse(was.id, "an element with its id exists again")

    def _content_as(self, was: Element, now: Element) -> ElementChanges:
        """Returns the changes that restore the content of an element."""
        current = self._current(now)
        keys = {k for k in {*was._props, *now._props} if not _same(was._props.get(k), now._props.get(k))}
        self._check_content(current, now, keys, was)
        return ElementChanges(
            {k: was._props[k] for k in keys if k in was._props},
            [k for k in keys if k not in was._props],
            label=was.label if was.label != now.label else None,
            type=was.type if was.type != now.type else None,
        )

    def _check_content(self, current: Element, now: Element, keys: Iterable[str], was: Element | None = None) -> None:
        for key in sorted(keys):
            expected, found = now._props.get(key), current._props.get(key)
            if not _same(expected, found):
                self._refuse(now.id, f"{local_name(key)} is now {_value_text(found)}, expected {_value_text(expected)}")
        for attribute, before, made, by_now in (
            ("label", was.label if was else None, now.label, current.label),
            ("class", was.type if was else None, now.type, current.type),
        ):
            if made not in (before, by_now):
                self._refuse(now.id, f"its {attribute} is now {by_now or '(none)'}, expected {made or '(none)'}")

    def _check_relation(self, relation: _Relation, is_there: bool) -> None:
        src, pred, dst = relation
        text = f"{src} {local_name(pred)} {dst}"
        for eid in (src, dst):
            if self._elements[eid] is None and eid not in self._recreated and (eid == src or _is_id(eid)):
                self._refuse(eid, f"it does not exist any more; cannot restore {text!r}")
        subject = self._elements[src]
        found = subject is not None and any(
            r["src"] == "-1" and (r["type"], r["dst"]) == (pred, dst) for r in subject._rels
        )
        if found != is_there:
            self._refuse(src, f"the relation {text!r} {'was removed' if is_there else 'was added again'}")

    def _current(self, element: Element) -> Element:
        current = self._elements[element.id]
        if current is None:
            self._refuse(element.id, "it does not exist any more")
        assert current is not None
        return current

    def _refuse(self, eid: str, reason: str) -> None:
        who = self._who(eid)
        raise Refused(f"{eid} was changed{f' by {who}' if who else ''}: {reason}")


def _either(was: Element | None, now: Element | None) -> Element:
    found = was if was is not None else now
    assert found is not None
    return found


def _ends(relation: dict[str, Any]) -> _Relation:
    return relation["src"], relation["type"], relation["dst"]


def _own(relation: dict[str, Any], dst: str) -> dict[str, Any]:
    """Returns the relation as stored at its subject."""
    return relation_dict("-1", relation["type"], dst)


def _is_id(name: str) -> bool:
    return name.rpartition("-")[2].isdigit()


def _same(one: Property | None, other: Property | None) -> bool:
    values, others = (prop.values if prop is not None else [] for prop in (one, other))
    if (one is None) != (other is None):
        return False
    return len(values) == len(others) and all(map(same_value, values, others))


def _value_text(prop: Property | None) -> str:
    return format_values(prop.values) if prop is not None and prop.values else "not there" if prop is None else "empty"


def recorded_change(
    change: Change,
    before: Mapping[str, ElementRecord | None],
    after: Mapping[str, ElementRecord | None],
    related_before: Set[_Relation],
    related_after: Set[_Relation],
) -> HistoryEntry:
    """Returns what a change has changed.

    :param before, after: the elements involved; None if there was or is none.
    :param related_before, related_after: their relations.
    """
    entry = HistoryEntry(change.number, change.stamp, change.author, "change")
    for eid, was in before.items():
        now = after[eid]
        if was is not None and now is not None and _same_content(was, now):
            continue
        entry.before += [_element(was)] if was is not None else []
        entry.after += [_element(now)] if now is not None else []
    entry.related = [relation_dict(*r) for r in sorted(related_after - related_before)]
    entry.unrelated = [relation_dict(*r) for r in sorted(related_before - related_after)]
    return entry


def _same_content(one: ElementRecord, other: ElementRecord) -> bool:
    if (one.type, one.label, one.properties.keys()) != (other.type, other.label, other.properties.keys()):
        return False
    return one.properties is other.properties or all(
        prop is other.properties[key] or prop.values == other.properties[key].values
        for key, prop in one.properties.items()
    )


def _element(record: ElementRecord) -> Element:
    return Element.shared(record.type, record.label, record.id, record.properties, (), record.version)
