"""Queries on scenes and the ontologies, for the server, the adapter in process and replicas."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import ANY_TYPE, full_name
from skiros2_common.core.operations import SCENE
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.scene import ChangeInfo, Scene

#: Up to this number of candidates are filtered one by one, without an index of property values.
_FEW = 100


def matching_ids(scene: Scene, ontology: Ontology, wanted: Element) -> list[str]:
    """The ids of the elements that match an abstract element by class, label and property values.

    An empty label, and a value "" or None, matches any.
    """
    any_type = wanted.type in ANY_TYPE
    types = frozenset[str]() if any_type else ontology.subclasses(full_name(wanted.type))
    values = _values(wanted)
    if wanted.label:
        groups = [scene.of_label(wanted.label)]
    else:
        groups = [scene.of_type(t) for t in scene.types() if any_type or t in types]
    if not wanted.label and not values:
        return list(chain.from_iterable(groups))
    found: dict[str, None] = {}
    for eid in chain.from_iterable(_fewest(scene, groups, values)):
        record = scene.record(eid)
        assert record is not None
        is_of_type = any_type or record.type in types
        if is_of_type and wanted.label in ("", record.label) and _has_values(record.properties, values):
            found[eid] = None
    return list(found)


def branch_ids(scene: Scene, ontology: Ontology, root: str, relation_filter: str, type_filter: str = "") -> list[str]:
    """An element and its descendants along a relation and its subproperties, nearest first.

    :param type_filter: returns only elements of this class or its subclasses; "": all.
    """
    predicates = ontology.subproperties(full_name(relation_filter)) if relation_filter else None
    found = {root: None}
    waiting = [root]
    for eid in waiting:
        for _, _, dst in scene.relations(eid, predicates):
            if dst not in found and dst in scene:
                found[dst] = None
                waiting.append(dst)
    if not type_filter:
        return list(found)
    types = ontology.subclasses(full_name(type_filter))
    return [eid for eid in found if _type_of(scene, eid) in types]


def cascade_ids(scene: Scene, ontology: Ontology, root: str, relation_filter: str, type_filter: str = "") -> list[str]:
    """The elements to remove with an element: its descendants that no other element holds.

    :param relation_filter, type_filter: as for `branch_ids`.
    """
    predicates = ontology.subproperties(full_name(relation_filter))
    gone = dict.fromkeys([root, *branch_ids(scene, ontology, root, relation_filter, type_filter)])
    waiting = list(gone)
    while waiting:
        eid = waiting.pop()
        held = any(src not in gone for src, _, _ in scene.relations("", predicates, eid))
        if eid in gone and eid != root and held:
            del gone[eid]
            waiting += [dst for _, _, dst in scene.relations(eid, predicates) if dst in gone]
    return list(gone)


def relations_between(scene: Scene, ontology: Ontology, src: str, pred: str, dst: str) -> Iterator[RelationDict]:
    """The relations along a predicate and its subproperties; an empty part matches any."""
    for found in scene.relations(src, _predicates(ontology, pred), dst):
        yield relation_dict(*found)


def holds_between(scene: Scene, ontology: Ontology, src: Element, pred: str, dst: Element) -> bool:
    """Whether a relation or one of its subproperties holds; a side without id stands for any matching element."""
    is_pair = bool(src.id and dst.id)
    if is_pair and scene.related(src.id, pred, dst.id):
        return True
    predicates = ontology.subproperties(pred)
    if is_pair:
        return any(scene.related(src.id, p, dst.id) for p in predicates)
    if src.id:
        found = (other for _, _, other in scene.relations(src.id, predicates))
        return any(is_like(scene, ontology, other, dst) for other in found)
    if dst.id:
        found = (other for other, _, _ in scene.relations("", predicates, dst.id))
        return any(is_like(scene, ontology, other, src) for other in found)
    return any(
        is_like(scene, ontology, other, dst)
        for eid in matching_ids(scene, ontology, src)
        for _, _, other in scene.relations(eid, predicates)
    )


def is_like(scene: Scene, ontology: Ontology, eid: str, wanted: Element) -> bool:
    """Whether an element matches an abstract element."""
    record = scene.record(eid)
    return record is not None and describes(ontology, wanted, record.type, record.label, record.properties)


def describes(ontology: Ontology, wanted: Element, etype: str, label: str, properties: Mapping[str, Property]) -> bool:
    """Whether an abstract element matches a class, label and properties."""
    return (
        (wanted.type in ANY_TYPE or ontology.is_subclass(etype, full_name(wanted.type)))
        and wanted.label in ("", label)
        and _has_values(properties, _values(wanted))
    )


def _fewest(
    scene: Scene, groups: Sequence[Collection[str]], values: list[tuple[str, list[Any]]]
) -> Sequence[Collection[str]]:
    """Groups of candidate ids: the given groups, or smaller ones from an index of a value."""
    count = sum(map(len, groups))
    for key, asked in values:
        for value in asked:
            if count <= _FEW:
                return groups
            having = scene.of_value(key, value)
            if having is not None and sum(map(len, having)) < count:
                groups, count = having, sum(map(len, having))
    return groups


def _values(wanted: Element) -> list[tuple[str, list[Any]]]:
    """The values that an abstract element requires, by property."""
    asked = (
        (full_name(key), [v for v in prop.values if v not in ("", None)]) for key, prop in wanted.property_view.items()
    )
    return [(key, values) for key, values in asked if values]


def _has_values(properties: Mapping[str, Property], values: list[tuple[str, list[Any]]]) -> bool:
    for key, asked in values:
        prop = properties.get(key)
        if prop is None or not all(any(same_value(v, wanted) for v in prop.values) for wanted in asked):
            return False
    return True


def _type_of(scene: Scene, eid: str) -> str:
    record = scene.record(eid)
    return record.type if record is not None else ""


def _predicates(ontology: Ontology, pred: str) -> frozenset[str] | None:
    return ontology.subproperties(full_name(pred)) if pred else None


def containment_cycle(scene: Scene, predicates: Collection[str], below: Iterable[str]) -> list[str]:
    """A containment cycle: ids of elements, each contained in the next, ending with the first; [] when there is none.

    :param predicates: the relations that place their object in their subject.
    :param below: the elements from which to search upwards.
    """
    done: set[str] = set()
    for start in below:
        path = {start: scene.relations("", predicates, start)} if start not in done else {}
        while path:
            eid, holders = next(reversed(path.items()))
            for holder, _, _ in holders:
                if holder in path:
                    ids = list(path)
                    return [*ids[ids.index(holder) :], holder]
                if holder not in done:
                    path[holder] = scene.relations("", predicates, holder)
                    break
            else:
                done.add(eid)
                del path[eid]
    return []


def format_cycle(cycle: Sequence[str]) -> str:
    """Formats a cycle; a long one is abbreviated."""
    ids = cycle if len(cycle) <= 8 else [*cycle[:4], "...", *cycle[-3:]]
    return " in ".join(ids)


class SceneReader:
    """Reads the scenes of contexts. Thread-safe.

    :param lock: guards the scenes.
    :param scenes: returns the scenes of a context; "": of all contexts. Called under the lock.
    :param ontology: returns the index of the current ontologies. Called without the lock.
    :param home: returns the context of an element, or "". Called under the lock.
    """

    def __init__(
        self,
        lock: threading.RLock,
        scenes: Callable[[str], Sequence[Scene]],
        ontology: Callable[[], Ontology],
        home: Callable[[str], str] = lambda eid: "",
    ) -> None:
        self._lock = lock
        self._scenes = scenes
        self._ontology = ontology
        self._home = home

    def find(self, eid: str, context: str) -> Element | None:
        """Returns the current state of an element, or None when it does not exist."""
        with self._lock:
            for scene in self._scenes(context):
                element = scene.element(eid)
                if element is not None:
                    return element
        return None

    def refreshed(self, element: Element, context: str) -> Element | None:
        """Returns the given element if it has not changed since it was read, else the result of `find`."""
        with self._lock:
            for scene in self._scenes(context):
                record = scene.record(element.id)
                if record is not None:
                    return element if record.change_info.version == element.version else scene.element(element.id)
        return None

    def has(self, eid: str, context: str) -> bool:
        """Whether an element exists."""
        with self._lock:
            return any(eid in scene for scene in self._scenes(context))

    def removal(self, eid: str, context: str) -> ChangeInfo | None:
        """The change that removed an element; None: the element exists, or its removal is unknown."""
        with self._lock:
            known = (scene.removal(eid) for scene in self._scenes(context))
            return next((change_info for change_info in known if change_info is not None), None)

    def matching(self, wanted: Element, context: str) -> list[Element]:
        """The elements that match an abstract element."""
        ontology = self._ontology()
        with self._lock:
            return [e for s in self._scenes(context) for e in _known_elements(s, matching_ids(s, ontology, wanted))]

    def branch(self, eid: str, relation_filter: str, type_filter: str, context: str) -> list[Element]:
        """An element and its descendants, nearest first; arguments as for `branch_ids`.

        :raises UnknownName: the element does not exist.
        """
        ontology = self._ontology()
        with self._lock:
            for scene in self._scenes(context):
                if eid in scene:
                    return _known_elements(scene, branch_ids(scene, ontology, eid, relation_filter, type_filter))
        raise UnknownName(no_element(eid, context))

    def related(self, src: str, pred: str, dst: str, context: str = "") -> list[RelationDict]:
        """The relations along a predicate and its subproperties; an empty part matches any.

        :param context: "": that of the subject, or the scene when no subject is given.
        """
        ontology = self._ontology()
        with self._lock:
            context = context or self._home(src) or SCENE
            return [r for scene in self._scenes(context) for r in relations_between(scene, ontology, src, pred, dst)]

    def holds(self, subj: Element, pred: str, obj: Element, context: str = SCENE) -> bool:
        """Whether a relation holds; a side without id stands for any matching element."""
        ontology = self._ontology()
        with self._lock:
            for scene in self._scenes(context):  # noqa: SIM110 - any() takes twice the time
                if holds_between(scene, ontology, subj, pred, obj):
                    return True
            return False


def no_element(eid: str, context: str) -> str:
    """The error text for an element that a context does not have."""
    return f"there is no element {eid!r} in context {context!r}"


def _known_elements(scene: Scene, ids: Sequence[str]) -> list[Element]:
    return [element for eid in ids if (element := scene.element(eid)) is not None]
