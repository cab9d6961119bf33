"""The operations of a request to the world model, and the changes that it publishes.

A request is a list of operations that is applied as a whole or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from skiros2_common.core.changeset import ChangeSet
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict

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
    (`changeset.py`).
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


def snapshot_number(snapshot_id: str) -> int:
    """The number of the change that led to a state; 0 when the snapshot id has no number."""
    number = snapshot_id.rpartition("-")[2]
    return int(number) if number.isdecimal() else 0


@dataclass(frozen=True)
class CleanupAction:
    """Changes to each element of the scene whose property `key` is `value`.

    :param relation: removes the objects of this relation and its subproperties; "": none.
    :param below: removes the objects together with their descendants along this relation.
    :param properties: writes these properties, by key; a property without values is removed.
    """

    key: str
    value: str
    relation: str = ""
    below: str = "skiros:sceneProperty"
    properties: Mapping[str, Property] = field(default_factory=dict)
