"""Taking a change of the scene back: what undoes it, if what it made is still so.

What a change made other is a `HistoryEntry`. It is undone by operations that make the same things what they were
before, in one request. Where somebody else has changed one of these things since, nothing is undone, and the error says
what and who. Everything else about the elements may have changed freely.
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
    """The operations that take a change back; they are refused as a conflict if an element changes before they come.

    :param find: an element of the scene as it is now, with its relations both ways.
    :param who: tells who has changed an element last, and when, such as "vision at 14:05:03"; "" when nobody knows.
    :raises Refused: something that the change made has become other since; the text says what.
    """
    return _Revert(entry, find, who).operations()


def merge_entries(entries: Iterable[HistoryEntry]) -> HistoryEntry:
    """Several changes, one after the other, as one: from what was before the first to what was after the last."""
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
        for told, is_there in ((entry.unrelated, False), (entry.related, True)):
            for r in told:
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
        self._present = {eid: find(eid) for eid in dict.fromkeys([*ids, *ends])}
        self._made_anew = {was.id: f"{i}" for i, (was, now) in enumerate(entry.pairs()) if was and not now}
        self._to_remove = {now.id for was, now in entry.pairs() if now and not was}

    def operations(self) -> list[Operation]:
        adds: list[Operation] = []
        patches: dict[str, ElementChanges] = {}
        for was, now in self._entry.pairs():
            if was is None and now is not None:
                self._check_added(now)
            elif now is None and was is not None:
                self._check_removed(was)
                anew = Element(was.type, was.label, was.id)
                anew._props = dict(was._props)
                adds.append(Add(anew, self._made_anew[was.id]))
            elif was is not None and now is not None:
                patches[was.id] = self._content_as(was, now)
        for r in self._entry.related:
            self._check_relation(_ends(r), True)
            if r["src"] not in self._to_remove and r["dst"] not in self._to_remove:
                patches.setdefault(r["src"], ElementChanges()).removed_relations.append(_own(r, r["dst"]))
        relations: list[Operation] = []
        for r in self._entry.unrelated:
            self._check_relation(_ends(r), False)
            dst = f"#{self._made_anew[r['dst']]}" if r["dst"] in self._made_anew else r["dst"]
            if r["src"] in self._made_anew:
                add = next(a for a in adds if isinstance(a, Add) and a.element.id == r["src"])
                assert isinstance(add, Add)
                add.element._rels = [*add.element._rels, _own(r, dst)]
            else:
                patches.setdefault(r["src"], ElementChanges()).added_relations.append(_own(r, dst))
        changed = [*patches, *self._to_remove]
        expected = [Expect(eid, e.version) for eid in changed if (e := self._present.get(eid)) is not None]
        removals = [Remove(eid, recursive=False) for eid in self._to_remove]
        written = [Patch(eid, changes) for eid, changes in patches.items() if changes]
        return [*expected, *adds, *written, *relations, *removals]

    # -- whether what the change made is still so --------------------------------------------------------------

    def _check_added(self, now: Element) -> None:
        present = self._there(now)
        self._check_content(present, now, {*now._props, *present._props})
        told = {_ends(r) for r in self._entry.related}
        for r in present._rels:
            src, dst = (present.id if r[side] == "-1" else r[side] for side in ("src", "dst"))
            if (src, r["type"], dst) not in told:
                self._refuse(present.id, f"it is related since: {src} {local_name(r['type'])} {dst}")

    def _check_removed(self, was: Element) -> None:
        if self._present[was.id] is not None:
            self._refuse(was.id, "there is an element with its id again")

    def _content_as(self, was: Element, now: Element) -> ElementChanges:
        """What makes the content of an element again what it was."""
        present = self._there(now)
        keys = {k for k in {*was._props, *now._props} if not _same(was._props.get(k), now._props.get(k))}
        self._check_content(present, now, keys, was)
        return ElementChanges(
            {k: was._props[k] for k in keys if k in was._props},
            [k for k in keys if k not in was._props],
            label=was.label if was.label != now.label else None,
            type=was.type if was.type != now.type else None,
        )

    def _check_content(self, present: Element, now: Element, keys: Iterable[str], was: Element | None = None) -> None:
        for key in sorted(keys):
            expected, found = now._props.get(key), present._props.get(key)
            if not _same(expected, found):
                self._refuse(now.id, f"{local_name(key)} is {_told(found)} by now, no more {_told(expected)}")
        for what, before, made, by_now in (
            ("label", was.label if was else None, now.label, present.label),
            ("class", was.type if was else None, now.type, present.type),
        ):
            if made not in (before, by_now):
                self._refuse(now.id, f"its {what} is {by_now or '(none)'} by now, no more {made or '(none)'}")

    def _check_relation(self, relation: _Relation, is_there: bool) -> None:
        src, pred, dst = relation
        told = f"{src} {local_name(pred)} {dst}"
        for eid in (src, dst):
            if self._present[eid] is None and eid not in self._made_anew and (eid == src or _is_id(eid)):
                self._refuse(eid, f"it is there no more, so that {told!r} cannot be changed back")
        subject = self._present[src]
        found = subject is not None and any(
            r["src"] == "-1" and (r["type"], r["dst"]) == (pred, dst) for r in subject._rels
        )
        if found != is_there:
            self._refuse(src, f"the relation {told!r} {'is gone' if is_there else 'is there again'} by now")

    def _there(self, element: Element) -> Element:
        present = self._present[element.id]
        if present is None:
            self._refuse(element.id, "it is there no more")
        assert present is not None
        return present

    def _refuse(self, eid: str, what: str) -> None:
        who = self._who(eid)
        raise Refused(f"{eid} was changed{f' by {who}' if who else ''}: {what}")


def _either(was: Element | None, now: Element | None) -> Element:
    found = was if was is not None else now
    assert found is not None
    return found


def _ends(relation: dict[str, Any]) -> _Relation:
    return relation["src"], relation["type"], relation["dst"]


def _own(relation: dict[str, Any], dst: str) -> dict[str, Any]:
    """The relation as its subject has it."""
    return relation_dict("-1", relation["type"], dst)


def _is_id(name: str) -> bool:
    return name.rpartition("-")[2].isdigit()


def _same(one: Property | None, other: Property | None) -> bool:
    values, others = (prop.values if prop is not None else [] for prop in (one, other))
    if (one is None) != (other is None):
        return False
    return len(values) == len(others) and all(map(same_value, values, others))


def _told(prop: Property | None) -> str:
    return format_values(prop.values) if prop is not None and prop.values else "not there" if prop is None else "empty"


def recorded_change(
    change: Change,
    before: Mapping[str, ElementRecord | None],
    after: Mapping[str, ElementRecord | None],
    related_before: Set[_Relation],
    related_after: Set[_Relation],
) -> HistoryEntry:
    """What is other after a change.

    :param before, after: the elements that it was about, None where there was or is none.
    :param related_before, related_after: the relations from and to these.
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


def _element(node: ElementRecord) -> Element:
    return Element.shared(node.type, node.label, node.id, node.properties, (), node.version)
