"""From elements as users change them to operations on a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.element_relations import relation_key
from skiros2_common.core.names import full_name
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict
from skiros2_world_model.core.changes import Add, Operation, Patch, Update, relation_dict


@dataclass
class ChangesLeft:
    """Changes of an element that a write has left out."""

    properties: dict[str, Property] = field(default_factory=dict)
    removed_properties: list[str] = field(default_factory=list)
    added_relations: list[RelationDict] = field(default_factory=list)
    removed_relations: list[RelationDict] = field(default_factory=list)

    def put_back(self, element: Element) -> None:
        """Makes them changes of the element again, after it was read anew."""
        for key, prop in self.properties.items():
            element._put(key, prop)
        for key in self.removed_properties:
            element.removeProperty(key)
        element.removeRelations(self.removed_relations)
        for r in self.added_relations:
            element.addRelation(*relation_key(r))


def added_elements(elements: Sequence[Element], exists: Callable[[str], bool]) -> tuple[list[Element], list[Operation]]:
    """What adds elements with the children kept aside in them.

    :param exists: whether an id is an element of the scene, which then is no new child.
    :returns: the elements and children, and an operation for each.
    """
    family = _Family(exists)
    for element in elements:
        family.include(element)
    additions = family.additions()
    return family.members, list(additions)


def written(elements: Sequence[Element], exists: Callable[[str], bool]) -> tuple[list[Element], list[Operation]]:
    """What writes some elements, with their children kept aside.

    :returns: the elements and children that the operations are about, and the operations; unchanged ones have none.
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
    """What writes the properties of an element, or those with the keys; nothing when none was changed."""
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


def changes_left(element: Element, keys: frozenset[str] | None) -> ChangesLeft:
    """The changes that `written_properties` leaves out."""
    changes = element.changes()
    if changes is None:
        return ChangesLeft()
    return ChangesLeft(
        {key: prop for key, prop in changes.properties.items() if keys is not None and full_name(key) not in keys},
        [key for key in changes.removed_properties if keys is not None and full_name(key) not in keys],
        changes.added_relations,
        changes.removed_relations,
    )


class _Family:
    """Elements that are added together. Each has a reference by which the others' relations name it."""

    def __init__(self, exists: Callable[[str], bool]) -> None:
        self._exists = exists
        self._references: dict[int, str] = {}
        self.members: list[Element] = []

    def include(self, element: Element) -> str:
        """Adds an element; returns the name by which relations refer to it."""
        known = self._references.get(id(element))
        if known is None:
            known = self._references[id(element)] = str(len(self.members))
            self.members.append(element)
        return f"#{known}"

    def children_of(self, element: Element, name: str) -> list[RelationDict]:
        """Adds the children kept aside in an element; returns the relations to them, for the element itself."""
        relations = []
        for subj, pred, obj in element.local_relations:
            src, dst = (self._end(side, name) for side in (subj, obj))
            relations.append(relation_dict(src, pred, dst))
        return relations

    def additions(self) -> list[Add]:
        """An operation for each element, and for the children of each, which become members."""
        adds = []
        for element in self.members:  # grows meanwhile
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
    """The element without children, over the same properties, which nobody changes."""
    bare = Element(element.type, element.label, element.id)
    bare._props = element._props
    bare._rels = element._rels
    return bare
