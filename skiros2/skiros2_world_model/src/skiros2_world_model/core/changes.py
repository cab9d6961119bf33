"""The operations of a request, the changes that it publishes, and the translation of changed elements to operations.

A request is a list of operations that is applied as a whole or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.element_content import relation_key
from skiros2_common.core.names import full_name
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict
from skiros2_world_model.core.changeset import ChangeSet

#: The name of the context with the elements that skills, planning and the GUI see.
SCENE = "scene"

#: The name of the context with the ontologies. It holds no elements.
ONTOLOGY = "ontology"


#: Subject, predicate, object, and whether the statement is added (True) or removed.
Statement = tuple[str, str, str, bool]


#: The actions of changes.
ADD, UPDATE, REMOVE, REMOVE_RECURSIVE, RESET = "add", "update", "remove", "remove_recursive", "reset"

#: The property that names the template of an element.
TEMPLATE = "skiros:Template"

#: The superproperty of relations that place one element in another. A scene has no cycle of them.
SPATIAL = "skiros:spatiallyRelated"


@dataclass
class Add:
    """Adds an element. Its relations may refer to other new elements of the request as `#` and their `reference`."""

    element: Element
    reference: str = ""


@dataclass
class Instantiate:
    """Copies a template and, if recursive, the individuals it is related to by the relations of the filter.

    :param relations: additional relations of the copy; "-1" is the copy.
    :param known: individuals that are not copied.
    """

    uri: str
    recursive: bool = False
    relations: Sequence[RelationDict] = ()
    relation_filter: Sequence[str] = ("skiros:hasA", "skiros:contain")
    known: frozenset[str] = frozenset()
    reference: str = ""


@dataclass
class Update:
    """Replaces the content of an element: properties and relations that the new content lacks are removed.

    :param relations: whether relations are written, too.
    :param keys: the properties to write; None: all.
    """

    element: Element
    relations: bool = True
    keys: frozenset[str] | None = None


@dataclass
class Patch:
    """Changes parts of an element. Added relations may refer to new elements of the request, as in `Add`."""

    id: str
    changes: ElementChanges


@dataclass
class Remove:
    """Removes an element and, if recursive, its descendants that no other element holds.

    :param relation_filter: descendants are reached along this relation and its subproperties.
    :param type_filter: only descendants of this class are removed; "": all.
    """

    id: str
    recursive: bool = True
    relation_filter: str = "skiros:sceneProperty"
    type_filter: str = ""


@dataclass(frozen=True)
class Relate:
    """Adds (`value` true) or removes a relation."""

    src: str
    pred: str
    dst: str
    value: bool = True


@dataclass
class Expect:
    """Changes nothing, but refuses the request if an element has changed since it was read.

    :param version: `Element.version` when it was read.
    """

    id: str
    version: int


@dataclass
class Apply:
    """Applies a change set, such as the inverse of an earlier one to revert it.

    Refused, with all parts that have changed since, unless the scene still is as the change set has it before
    (`core/changeset.py`).
    """

    change_set: ChangeSet


Operation = Add | Instantiate | Update | Patch | Remove | Relate | Expect | Apply


@dataclass(frozen=True, eq=False)
class Change:
    """A published change.

    An update without elements and relations means that the ontologies or another context have changed.

    :param number: increases with every change.
    :param prev_snapshot_id, snapshot_id: the names of the states before and after the change.
    :param stamp: the time of the change (s since the epoch).
    :param action: one of this module's actions.
    :param elements: added or updated elements in their new state, or removed elements in their last state.
    :param relations: relations added or removed without their elements, as dicts.
    """

    number: int
    prev_snapshot_id: str
    snapshot_id: str
    stamp: float
    author: str
    action: str
    context: str
    elements: tuple[Element, ...] = ()
    relations: tuple[RelationDict, ...] = ()


@dataclass
class Outcome:
    """The result of a request: the id that each operation affected, and the published changes."""

    ids: list[str] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)

    @property
    def elements(self) -> dict[str, Element]:
        """The added and updated elements, by id."""
        return {e.id: e for c in self.changes if c.action in (ADD, UPDATE) for e in c.elements}


def relation_dict(src: str, pred: str, dst: str) -> dict[str, Any]:
    """A relation as a dict, in the format of SkiROS2."""
    return {"src": src, "type": pred, "dst": dst, "state": True, "abstract": False}


def snapshot_number(snapshot_id: str) -> int:
    """The number of the change that led to a state; 0 when the snapshot id has no number."""
    number = snapshot_id.rpartition("-")[2]
    return int(number) if number.isdecimal() else 0


@dataclass
class RemainingChanges:
    """Changes of an element that a partial write did not include."""

    properties: dict[str, Property] = field(default_factory=dict)
    removed_properties: list[str] = field(default_factory=list)
    added_relations: list[RelationDict] = field(default_factory=list)
    removed_relations: list[RelationDict] = field(default_factory=list)

    def restore(self, element: Element) -> None:
        """Applies the changes to the element again after it was refreshed."""
        for key, prop in self.properties.items():
            element._put(key, prop)
        for key in self.removed_properties:
            element.removeProperty(key)
        element.removeRelations(self.removed_relations)
        for r in self.added_relations:
            element.addRelation(*relation_key(r))


def added_elements(elements: Sequence[Element], exists: Callable[[str], bool]) -> tuple[list[Element], list[Operation]]:
    """The operations that add elements together with their local children.

    :param exists: whether the scene has an element of an id; existing elements are not added as children.
    :returns: the elements and children, and an operation for each.
    """
    family = _Family(exists)
    for element in elements:
        family.include(element)
    additions = family.additions()
    return family.members, list(additions)


def written(elements: Sequence[Element], exists: Callable[[str], bool]) -> tuple[list[Element], list[Operation]]:
    """The operations that write changed elements together with their local children.

    :returns: the elements and children to write, and an operation for each. Unchanged elements are omitted.
    """
    family = _Family(exists)
    given: list[Element] = []
    updates: list[Operation] = []
    for element in elements:
        own = family.children_of(element, "-1")
        changes = element.changes()
        if changes is None:
            whole = _bare(element)
            whole._rels = [*element._rels, *own]
            updates.append(Update(whole))
        else:
            changes.added_relations = [*changes.added_relations, *own]
            if not changes:
                continue
            updates.append(Patch(element.id, changes))
        given.append(element)
    additions = family.additions()
    return [*family.members, *given], [*additions, *updates]


def written_properties(element: Element, keys: frozenset[str] | None) -> list[Operation]:
    """The operation that writes the changed properties of an element, limited to `keys`; none when nothing changed."""
    changes = element.changes()
    if changes is None:
        return [Update(_bare(element), False, keys)]
    changes = ElementChanges(
        {key: prop for key, prop in changes.properties.items() if keys is None or full_name(key) in keys},
        [key for key in changes.removed_properties if keys is None or full_name(key) in keys],
        label=changes.label if keys is None else None,
        type=changes.type if keys is None else None,
    )
    return [Patch(element.id, changes)] if changes else []


def remaining_changes(element: Element, keys: frozenset[str] | None) -> RemainingChanges:
    """The changes that `written_properties` does not write."""
    changes = element.changes()
    if changes is None:
        return RemainingChanges()
    return RemainingChanges(
        {key: prop for key, prop in changes.properties.items() if keys is not None and full_name(key) not in keys},
        [key for key in changes.removed_properties if keys is not None and full_name(key) not in keys],
        changes.added_relations,
        changes.removed_relations,
    )


class _Family:
    """Elements that are added in one request. Relations refer to each by a reference."""

    def __init__(self, exists: Callable[[str], bool]) -> None:
        self._exists = exists
        self._references: dict[int, str] = {}
        self.members: list[Element] = []

    def include(self, element: Element) -> str:
        """Adds an element and returns its reference, `#number`."""
        known = self._references.get(id(element))
        if known is None:
            known = self._references[id(element)] = str(len(self.members))
            self.members.append(element)
        return f"#{known}"

    def children_of(self, element: Element, name: str) -> list[RelationDict]:
        """Adds the local children of an element and returns its relations to them."""
        relations = []
        for subj, pred, obj in element.local_relations:
            src, dst = (self._end(side, name) for side in (subj, obj))
            relations.append(relation_dict(src, pred, dst))
        return relations

    def additions(self) -> list[Add]:
        """Creates an operation for each member, adding their children as members."""
        adds = []
        for element in self.members:  # grows during the iteration
            reference = self._references[id(element)]
            flat = _bare(element)
            flat._rels = [*element._rels, *self.children_of(element, f"#{reference}")]
            adds.append(Add(flat, reference))
        return adds

    def _end(self, side: Element | str, name: str) -> str:
        if not isinstance(side, Element):
            return name if side == "-1" else side
        if side.id and self._exists(side.id):
            return side.id
        return self.include(side)


def _bare(element: Element) -> Element:
    """A shallow copy of the element without its local children."""
    bare = Element(element.type, element.label, element.id)
    bare._props = element._props
    bare._rels = element._rels
    return bare
