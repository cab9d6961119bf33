"""The change set: the one record of a change of a scene."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element

#: Subject, predicate and object of a relation, with ids.
Relation = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class ChangeInfo:
    """The change that last modified something: its number, its time (s since the epoch) and its author."""

    version: int = 0
    stamp: float = 0.0
    author: str = ""


UNKNOWN = ChangeInfo()


@dataclass(frozen=True, slots=True)
class ElementRecord:
    """The stored content of one element, without relations. Immutable: a change stores a new record."""

    id: str
    type: str
    label: str
    properties: dict[str, Property]
    change_info: ChangeInfo = UNKNOWN

    @property
    def version(self) -> int:
        """The number of the last change."""
        return self.change_info.version

    def equals(self, other: ElementRecord) -> bool:
        """Whether class, label and properties are equal."""
        one, two = self.properties, other.properties
        if (self.type, self.label, one.keys()) != (other.type, other.label, two.keys()):
            return False
        return one is two or all(p is two[key] or p.values == two[key].values for key, p in one.items())

    def element(self) -> Element:
        """The element, without relations. Copies on write."""
        return Element.shared(self.type, self.label, self.id, self.properties, (), self.version)


def same_values(one: Property | None, other: Property | None) -> bool:
    """Whether two properties have equal values, a number and its text being equal. None is a missing property."""
    if one is None or other is None or one is other:
        return one is other
    values, others = one.values, other.values
    return len(values) == len(others) and all(map(same_value, values, others))


#: An element before and after a change; None where it does not exist.
Pair = tuple[ElementRecord | None, ElementRecord | None]


@dataclass
class ChangeSet:
    """Everything that a change has changed. False when there is nothing.

    :ivar records: by id, each added, changed or removed element before and after.
    :ivar relations: the added (True) and removed (False) relations.
    :ivar statements: the added (True) and removed (False) RDF statements that belong to no element, as N-Triples.
    """

    records: dict[str, Pair] = field(default_factory=dict)
    relations: dict[Relation, bool] = field(default_factory=dict)
    statements: dict[str, bool] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.records or self.relations or self.statements)

    # -- recording ---------------------------------------------------------------------------------------------

    def put(self, eid: str, before: ElementRecord | None, after: ElementRecord | None) -> None:
        """Records a change of an element. Its first state before stays; a return to that state cancels the change."""
        known = self.records.get(eid)
        if known is not None and known[0] is after:
            del self.records[eid]
        else:
            self.records[eid] = (before if known is None else known[0], after)

    def relate(self, relation: Relation, added: bool) -> None:
        """Records that a relation was added or removed; the inverse of a recorded change cancels it."""
        if self.relations.get(relation, added) == added:
            self.relations[relation] = added
        else:
            del self.relations[relation]

    def extend(self, later: ChangeSet) -> None:
        """Adds the changes of a later change set."""
        for eid, (before, after) in later.records.items():
            self.put(eid, before, after)
        for relation, added in later.relations.items():
            self.relate(relation, added)
        for statement, added in later.statements.items():
            if self.statements.get(statement, added) == added:
                self.statements[statement] = added
            else:
                del self.statements[statement]

    # -- reading -----------------------------------------------------------------------------------------------

    def ids(self) -> dict[str, None]:
        """The ids of all elements that changed or whose relations changed, removed ones included."""
        ends = (eid for src, _, dst in self.relations for eid in (src, dst))
        return {**dict.fromkeys(self.records), **dict.fromkeys(ends)}

    def is_added(self, eid: str) -> bool:
        """Whether an element was added."""
        before, after = self.records.get(eid, (None, None))
        return before is None and after is not None

    def removed(self) -> list[Element]:
        """The removed elements as they were, with their relations."""
        elements = {eid: b.element() for eid, (b, after) in self.records.items() if b is not None and after is None}
        if elements:
            for (src, pred, dst), added in self.relations.items():
                if not added and src in elements:
                    elements[src].addRelation("-1", pred, dst)
                if not added and dst in elements:
                    elements[dst].addRelation(src, pred, "-1")
        return [element.view() for element in elements.values()]

    def effective(self) -> ChangeSet:
        """This change set without the elements whose content has not changed."""
        records = {
            eid: (before, after)
            for eid, (before, after) in self.records.items()
            if before is not after and (before is None or after is None or not before.equals(after))
        }
        return ChangeSet(records, self.relations, self.statements)

    # -- using -------------------------------------------------------------------------------------------------

    def inverse(self) -> ChangeSet:
        """The change set that undoes this one."""
        return ChangeSet(
            {eid: (after, before) for eid, (before, after) in reversed(self.records.items())},
            {relation: not added for relation, added in reversed(self.relations.items())},
            {statement: not added for statement, added in reversed(self.statements.items())},
        )

    # -- JSON --------------------------------------------------------------------------------------------------

    def to_json(self) -> str:
        """Serializes the change set.

        :raises WrongValue: a value has a type that cannot be written.
        """
        texts = [
            f"[{_encode(eid)},{','.join('null' if r is None else record_json(r) for r in pair)}]"
            for eid, pair in self.records.items()
        ]
        parts = [[*relation, added] for relation, added in self.relations.items()]
        return (
            f'{{"elements":[{",".join(texts)}],"relations":{_encode(parts)},'
            f'"statements":{_encode(list(self.statements.items()))}}}'
        )

    @staticmethod
    def from_json(text: str) -> ChangeSet:
        """Parses a change set.

        :raises WrongValue: the text was not written by `to_json`.
        """
        try:
            content = json.loads(text)
            records = {eid: (_record(eid, before), _record(eid, after)) for eid, before, after in content["elements"]}
            relations = {(src, pred, dst): bool(added) for src, pred, dst, added in content["relations"]}
            return ChangeSet(records, relations, {t: bool(added) for t, added in content["statements"]})
        except (TypeError, ValueError, LookupError, AttributeError) as error:
            raise WrongValue(f"a change set cannot be read: {error}") from None


def merge(change_sets: Iterable[ChangeSet]) -> ChangeSet:
    """Merges successive change sets into one."""
    whole = ChangeSet()
    for change_set in change_sets:
        whole.extend(change_set)
    return whole


_PLAIN = (float, int, bool, str)
_TYPES: dict[str, type] = {kind.__name__: kind for kind in (*_PLAIN, list, dict, tuple)}

_encode = json.JSONEncoder(separators=(",", ":"), check_circular=False).encode


def record_json(record: ElementRecord) -> str:
    """The JSON of an element: `[class, label, {property: values}]`.

    The type of a property follows from its JSON values. A property without values, or of another type, is
    `{"type": name, "values": [...]}`.

    :raises WrongValue: a value has a type that cannot be written.
    """
    try:
        properties = {
            key: prop.current if prop.current and prop.dataType() in _PLAIN else _typed(prop)
            for key, prop in record.properties.items()
        }
        return _encode([record.type, record.label, properties])
    except (TypeError, ValueError) as error:
        raise WrongValue(f"{record.id}: {error}") from None


def read_record(eid: str, text: str, change_info: ChangeInfo = UNKNOWN) -> ElementRecord:
    """Parses the JSON of an element.

    :raises ValueError: the text was not written by `record_json`.
    """
    record = _record(eid, json.loads(text), change_info)
    if record is None:
        raise ValueError(f"{eid}: expected an element")
    return record


def _record(eid: str, content: Any, change_info: ChangeInfo = UNKNOWN) -> ElementRecord | None:
    if content is None:
        return None
    etype, label, properties = content
    read = {key: _property(key, values) for key, values in properties.items()}
    return ElementRecord(eid, etype, label, read, change_info)


def _typed(prop: Property) -> dict[str, Any]:
    kind = prop.dataType()
    if kind.__name__ not in _TYPES:
        raise TypeError(f"{prop.key}: values of type {kind.__name__} cannot be written")
    return {"type": kind.__name__, "values": prop.values}


def _property(key: str, content: Any) -> Property:
    if isinstance(content, list):
        return Property(key, content)
    kind = _TYPES[content["type"]]
    prop = Property(key, kind)
    prop.assign([tuple(value) for value in content["values"]] if kind is tuple else content["values"])
    return prop


class RecentChanges:
    """The ids of the elements that have changed, in this order. One thread at a time adds; any thread reads."""

    #: The number of ids that are kept at least.
    KEPT = 2000

    def __init__(self) -> None:
        self._known: tuple[int, list[str]] = 0, []  # how many were dropped, and the others

    @property
    def count(self) -> int:
        """The number of ids so far."""
        dropped, ids = self._known
        return dropped + len(ids)

    def add(self, changed: Collection[str]) -> None:
        """Adds the ids of a change, after it can be read."""
        dropped, ids = self._known
        ids.extend(changed)
        if len(ids) > 2 * self.KEPT:
            self._known = dropped + len(ids) - self.KEPT, ids[-self.KEPT :]

    def since(self, count: int) -> list[str] | None:
        """The ids after the first `count` ones; None if some of them were dropped."""
        dropped, ids = self._known
        return ids[count - dropped :] if count >= dropped else None


def patched(current: ElementRecord, before: ElementRecord, after: ElementRecord) -> ElementRecord:
    """The current record of an element with what differs between `before` and `after` as it is in `after`."""
    keys = changed_keys(before, after)
    properties = {key: prop for key, prop in current.properties.items() if key not in keys}
    properties |= {key: prop for key, prop in after.properties.items() if key in keys}
    etype = after.type if after.type != before.type else current.type
    label = after.label if after.label != before.label else current.label
    return ElementRecord(current.id, etype, label, properties)


def changed_keys(one: ElementRecord, other: ElementRecord) -> set[str]:
    """The properties in which two records differ."""
    keys = {*one.properties, *other.properties}
    return {key for key in keys if not same_values(one.properties.get(key), other.properties.get(key))}
