"""The translation of changed elements to operations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.element_content import relation_dict, relation_key
from skiros2_common.core.names import full_name
from skiros2_common.core.operations import Add, Operation, Patch, Update
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict


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
            element.put(key, prop)
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
            updates.append(Update(_flat(element, own)))
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
        return [Update(_flat(element, ()), False, keys)]
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
            adds.append(Add(_flat(element, self.children_of(element, f"#{reference}")), reference))
        return adds

    def _end(self, side: Element | str, name: str) -> str:
        if not isinstance(side, Element):
            return name if side == "-1" else side
        if side.id and self._exists(side.id):
            return side.id
        return self.include(side)


def _flat(element: Element, relations: Sequence[RelationDict]) -> Element:
    """A shallow copy of the element with additional relations, and without its local children."""
    content = element.property_view, [*element.relation_view, *relations]
    return Element.with_content(element.type, element.label, element.id, *content)
