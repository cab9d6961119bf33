"""What can be asked of a scene, and what is told of it.

A request is a list of operations that is applied whole or not at all. What came of it is told as changes, in order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.world_element import Element, ElementChanges, RelationDict

#: The actions of changes.
ADD, UPDATE, REMOVE, REMOVE_RECURSIVE, RESET = "add", "update", "remove", "remove_recursive", "reset"

#: The property with the name of the template that an element was copied from.
TEMPLATE = "skiros:Template"

#: Relations that place one element in another. A scene has no cycle of them.
SPATIAL = "skiros:spatiallyRelated"


@dataclass
class Add:
    """A new element. Its relations may name others that the same request makes: `#` and their `reference`."""

    element: Element
    reference: str = ""


@dataclass
class Instantiate:
    """Copies of a template and, if recursive, of what it is related to by the relations of the filter.

    :param relations: further ones of the copy; "-1" is the copy.
    """

    uri: str
    recursive: bool = False
    relations: Sequence[RelationDict] = ()
    relation_filter: Sequence[str] = ("skiros:hasA", "skiros:contain")
    known: frozenset[str] = frozenset()
    reference: str = ""


@dataclass
class Update:
    """New content for an element: what it does not have is removed.

    :param relations: whether relations are written too.
    :param keys: the properties that are written; None: all.
    """

    element: Element
    relations: bool = True
    keys: frozenset[str] | None = None


@dataclass
class Patch:
    """Some changes of an element; the rest stays. Relations may name elements that the same request makes."""

    id: str
    changes: ElementChanges


@dataclass
class Remove:
    """Removes an element and, if recursive, what is under it and is held by nothing else.

    :param relation_filter: what is under an element is what it has along these relations and those under them.
    :param type_filter: only elements of this class are taken with it; "": of any.
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
    """Changes nothing: refuses the request if an element was changed after a version of it was read.

    :param version: `Element.version` of what was read: the number of a change or state, no less than the element's own.
    """

    id: str
    version: int


Operation = Add | Instantiate | Update | Patch | Remove | Relate | Expect


@dataclass(frozen=True, eq=False)
class Change:
    """What is told of a change.

    :param number: counts up; the snapshot id names the state after this change, the previous one that before it.
    :param stamp: when (s since the epoch).
    :param action: one of this module's actions.
    :param elements: those added or updated, as they are now, or removed, as they were.
    :param relations: those added or removed beside them, as dicts.

    An update with neither says that something else has changed: the ontologies, or another context.
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
    """What came of a request: the id that each operation was about, and the changes that were told."""

    ids: list[str] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)

    @property
    def elements(self) -> dict[str, Element]:
        """The elements added or updated, by id."""
        return {e.id: e for c in self.changes if c.action in (ADD, UPDATE) for e in c.elements}


def relation_dict(src: str, pred: str, dst: str) -> dict[str, Any]:
    """A relation as libraries read it."""
    return {"src": src, "type": pred, "dst": dst, "state": True, "abstract": False}


def snapshot_number(snapshot_id: str) -> int:
    """The number of the change that led to a state; 0 when the name has none."""
    number = snapshot_id.rpartition("-")[2]
    return int(number) if number.isdecimal() else 0
