"""The scene: an in-memory index of elements. Every lookup is a dictionary access.

It indexes elements by id, class, label and (on demand) property value, and relations in both directions by predicate.
It performs no checks and knows no ontology; `WorldModel` validates before it writes. The server and the clients'
replicas use the same class.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from sys import intern

from skiros2_common.core.changeset import ChangeInfo, ChangeSet, ElementRecord, RecentChanges, Relation
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_common.core.world_model_port import Revisions
from skiros2_world_model.core.indexes import IdIndex, IdNumbers, PropertyPool, RelationCache, ValueIndex

__all__ = ["ROOT", "ChangeInfo", "ElementRecord", "Scene"]

#: The id of the root element.
ROOT = "skiros:Scene-0"

#: The number of removed elements that a scene remembers; the oldest are dropped first.
_MAX_REMOVALS = 10_000

_NO_PROPERTIES: Mapping[str, Property] = {}


class Scene:
    """The index of one scene. The owner must hold its lock while reading or writing.

    Changes are transactional: after `begin`, `roll_back` restores the previous state and `commit` keeps the new one.
    """

    def __init__(self) -> None:
        #: Changes that a graph sync has not written yet; None: no graph sync, or it must write the whole scene.
        self.unsynced: ChangeSet | None = None
        self.recent = RecentChanges()
        self._records: dict[str, ElementRecord] = {}
        self._out: dict[str, IdIndex] = {}  # by predicate: the objects of each subject
        self._in: dict[str, IdIndex] = {}  # by predicate: the subjects of each object
        self._by_type = IdIndex()
        self._by_label = IdIndex()
        self._by_value: dict[str, ValueIndex] = {}  # by property, built on first use
        self._numbers = IdNumbers()
        self._pool = PropertyPool()
        self._relation_cache = RelationCache()
        self._changes: ChangeSet | None = None  # of the current transaction; None outside transactions
        self._removals: dict[str, ChangeInfo] = {}

    # -- elements ----------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self._records)

    def __contains__(self, eid: object) -> bool:
        return eid in self._records

    def __iter__(self) -> Iterator[ElementRecord]:
        return iter(self._records.values())

    def record(self, eid: str) -> ElementRecord | None:
        return self._records.get(eid)

    def revisions(self, ontology: object) -> Revisions:
        """The revisions of its elements, and of these ontologies. They are used without the lock."""
        return Revisions(ontology, self._records.get, self.recent)

    def element(self, eid: str) -> Element | None:
        """Returns a copy-on-write element, or None when there is none of that id."""
        record = self._records.get(eid)
        if record is None:
            return None
        relations, made = self.relations_of(eid), record.change_info
        element = Element.shared(record.type, record.label, eid, record.properties, relations, made.version)
        element.last_update = made.stamp
        return element

    def types(self) -> list[str]:
        """The classes that have direct instances in the scene."""
        return [str(etype) for etype in self._by_type]

    def of_type(self, etype: str) -> Collection[str]:
        """The ids of the direct instances of a class."""
        return self._by_type.ids(etype)

    def of_label(self, label: str) -> Collection[str]:
        """The ids of the elements with a label."""
        return self._by_label.ids(label)

    def of_value(self, key: str, value: object) -> list[Collection[str]] | None:
        """Groups of ids that together contain every element with that value of a property, and some others.

        The first call for a property scans all elements and builds an index.

        :returns: None when the index cannot answer for a value of this type.
        """
        index = self._by_value.get(key)
        if index is None:
            index = ValueIndex()
            for record in self._records.values():
                if key in record.properties:
                    index.add(record.id, record.properties[key].values)
            self._by_value[key] = index
        return index.candidates(value)

    def put(self, record: ElementRecord) -> None:
        """Adds an element, or replaces its record; relations stay."""
        before = self._records.get(record.id)
        eid = before.id if before is not None else record.id
        known = before.properties if before is not None else _NO_PROPERTIES
        properties = {intern(k): p if known.get(k) is p else self._pool.shared(p) for k, p in record.properties.items()}
        self.replace(eid, ElementRecord(eid, intern(record.type), record.label, properties, record.change_info))

    def drop(self, eid: str) -> None:
        """Removes an element and all its relations, in both directions."""
        for relation in [*self.relations(eid), *self.relations(dst=eid)]:
            self.unrelate(*relation)
        self.replace(eid, None)

    def free_id(self, etype: str, desired: int = -1, others: Sequence[Scene] = ()) -> str:
        """Returns an unused id: with the desired number (from 0) if it is free, else with the next free number.

        :param others: scenes of other contexts in which the number must be free, too.
        """
        return f"{etype}-{self._numbers.free(desired, [scene._numbers for scene in others])}"

    @property
    def next_number(self) -> int:
        """The lowest number above all ids ever used. It never decreases, so that no id is reused."""
        return self._numbers.next

    def reserve(self, next_number: int) -> None:
        """Excludes all numbers below this one from new ids."""
        self._numbers.reserve(next_number)

    # -- relations ---------------------------------------------------------------------------------------------

    def relations_of(self, eid: str) -> tuple[RelationDict, ...]:
        """The outgoing and incoming relations of an element as dicts; "-1" stands for the element itself."""
        cached = self._relation_cache.get(eid)
        if cached:
            return cached
        relations: list[RelationDict] = []
        for pred, index in self._out.items():
            found = index.get(eid)
            if found is not None:
                for dst in (found,) if isinstance(found, str) else found:
                    relations.append(relation_dict("-1", pred, dst))
        for pred, index in self._in.items():
            found = index.get(eid)
            if found is not None:
                for src in (found,) if isinstance(found, str) else found:
                    relations.append(relation_dict(src, pred, "-1"))
        return self._relation_cache.put(eid, tuple(relations))

    def related(self, src: str, pred: str, dst: str) -> bool:
        """Whether this relation is stated; subproperties do not count."""
        index = self._out.get(pred)
        return index is not None and index.has(src, dst)

    def targets(self, src: str, pred: str) -> Collection[str]:
        """The objects of an element's relations with a predicate; subproperties do not count."""
        index = self._out.get(pred)
        return index.ids(src) if index is not None else ()

    def sources(self, pred: str, dst: str) -> Collection[str]:
        """The subjects of the relations with a predicate to an element; subproperties do not count."""
        index = self._in.get(pred)
        return index.ids(dst) if index is not None else ()

    def relations(
        self, src: str = "", preds: Collection[str] | None = None, dst: str = ""
    ) -> Iterator[tuple[str, str, str]]:
        """The relations that match a subject, a set of predicates and an object; "" and None match any."""
        for pred, index in self._out.items():
            if preds is not None and pred not in preds:
                continue
            if src and dst:
                if index.has(src, dst):
                    yield src, pred, dst
            elif src:
                for other in index.ids(src):
                    yield src, pred, other
            elif dst:
                for other in self._in[pred].ids(dst):
                    yield other, pred, dst
            else:
                for name in index:
                    for other in index.ids(name):
                        yield str(name), pred, other

    def relate(self, src: str, pred: str, dst: str) -> bool:
        """Adds a relation. Returns False when it already exists."""
        if self.related(src, pred, dst):
            return False
        src, dst = (self._records[n].id if n in self._records else n for n in (src, dst))  # share the id strings
        for links, here, there in ((self._out, src, dst), (self._in, dst, src)):
            index = links.get(pred)
            if index is None:
                index = links[pred] = IdIndex()
            index.add(here, there)
        self._record_relation((src, pred, dst), True)
        return True

    def unrelate(self, src: str, pred: str, dst: str) -> bool:
        """Removes a relation. Returns False when it does not exist."""
        if not self.related(src, pred, dst):
            return False
        for links, here, there in ((self._out, src, dst), (self._in, dst, src)):
            links[pred].discard(here, there)
            if not links[pred]:
                del links[pred]
        self._record_relation((src, pred, dst), False)
        return True

    # -- transactions ------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Starts a transaction, which `commit` or `roll_back` ends."""
        self._changes = ChangeSet()

    @property
    def changes(self) -> ChangeSet:
        """The changes of the current transaction so far."""
        return self._changes if self._changes is not None else ChangeSet()

    def roll_back(self) -> None:
        """Undoes all changes since `begin`."""
        changes, self._changes = self._changes, None
        if changes is not None:
            apply(changes.inverse(), self)
            self.recent.add(changes.ids())  # other threads may have looked up what was undone

    @contextmanager
    def nested(self) -> Iterator[ChangeSet]:
        """A transaction within the current one, which it becomes part of; an exception undoes only its own changes."""
        outer, inner = self._changes, ChangeSet()
        self._changes = inner
        is_done = False
        try:
            yield inner
            is_done = True
        finally:
            if not is_done:
                self.roll_back()
            elif outer is not None:
                outer.extend(inner)
            self._changes = outer

    def commit(self, change_info: ChangeInfo) -> ChangeSet:
        """Ends the transaction, sets the last change of every element that changed, and returns the changes."""
        changes, self._changes = self._changes, None
        if changes is None:
            return ChangeSet()
        for eid in changes.ids():
            old = self._records.get(eid)
            self._record_removal(eid, change_info if old is None else None)
            if old is not None:
                new = self._records[eid] = ElementRecord(eid, old.type, old.label, old.properties, change_info)
                if eid in changes.records:
                    changes.records[eid] = (changes.records[eid][0], new)
        self.recent.add(changes.ids())
        return changes

    def set_change_info(self, change_info: ChangeInfo) -> None:
        """Sets the last change of every element."""
        for eid, known in self._records.items():
            self._records[eid] = ElementRecord(eid, known.type, known.label, known.properties, change_info)

    def removal(self, eid: str) -> ChangeInfo | None:
        """The change that removed an element; None when it exists or its removal is unknown."""
        return None if eid in self._records else self._removals.get(eid)

    def inherit_removals(self, before: Scene, change_info: ChangeInfo | None) -> None:
        """Takes the removals of a scene that a change (None: unknown) replaces by this one."""
        removals = {**before._removals, **dict.fromkeys(before._records, change_info)}
        for eid, removed in removals.items():
            self._record_removal(eid, None if eid in self else removed)

    def _record_removal(self, eid: str, change_info: ChangeInfo | None) -> None:
        """Records that a change removed an element, or (None) that it exists or nothing is known."""
        self._removals.pop(eid, None)
        if change_info is not None:
            self._removals[eid] = change_info
            if len(self._removals) > _MAX_REMOVALS:
                del self._removals[next(iter(self._removals))]

    # -- the index itself --------------------------------------------------------------------------------------

    def replace(self, eid: str, record: ElementRecord | None) -> None:
        """Stores exactly this record of an element, or removes the element (None). Its relations stay."""
        before = self._records.get(eid)
        if before is not None and (record is None or record.type != before.type):
            self._by_type.discard(before.type, eid)
        if before is not None and (record is None or record.label != before.label):
            self._by_label.discard(before.label, eid)
        for key, index in self._by_value.items():
            old, new = _property(before, key), _property(record, key)
            if old is not new:
                index.discard(eid, old.values if old is not None else ())
                index.add(eid, new.values if new is not None else ())
        if record is None:
            del self._records[eid]
            self._relation_cache.discard(eid)
            self._numbers.count(eid, -1)
        else:
            self._records[eid] = record
            self._by_type.add(record.type, eid)
            self._by_label.add(record.label, eid)
            if before is None:
                self._numbers.count(eid, 1)
        if self._changes is not None:
            self._changes.put(eid, before, record)
        if self.unsynced is not None:
            self.unsynced.put(eid, before, record)

    def _record_relation(self, relation: Relation, added: bool) -> None:
        self._relation_cache.discard(relation[0])
        self._relation_cache.discard(relation[2])
        if self._changes is not None:
            self._changes.relate(relation, added)
        if self.unsynced is not None:
            self.unsynced.relate(relation, added)


def apply(change_set: ChangeSet, scene: Scene) -> None:
    """Makes the elements and relations of a scene as they are after a change. Nothing is checked."""
    for relation, added in change_set.relations.items():
        if not added:
            scene.unrelate(*relation)
    for eid, (_, after) in change_set.records.items():
        if after is not None or eid in scene:
            scene.replace(eid, after)
    for relation, added in change_set.relations.items():
        if added:
            scene.relate(*relation)


def _property(record: ElementRecord | None, key: str) -> Property | None:
    return record.properties.get(key) if record is not None else None
