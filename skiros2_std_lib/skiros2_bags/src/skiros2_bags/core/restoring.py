"""Making a world model as it was in a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Add, Operation, Relate, Remove, Update
from skiros2_world_model.core.scene import ROOT, Scene


@dataclass(frozen=True)
class Restored:
    """How many elements were otherwise."""

    added: int
    changed: int
    removed: int


def restore(wm: Any, scene: Scene) -> Restored:
    """Makes the scene of a world model as another one is, in one request: whole or not at all.

    Elements keep their ids. What running skill managers have told of their skills is replaced too.

    :param wm: a `WorldModelAbstractInterface`.
    :raises WmException: the world model does not answer, or refuses: its ontologies do not know a name, for one.
    """
    operations = restoring(scene, wm.resolve_elements(Element("")))
    if operations:
        wm.transact(operations)
    kinds = [sum(isinstance(o, kind) for o in operations) for kind in (Add, Update, Remove)]
    return Restored(*kinds)


def restoring(scene: Scene, present: Sequence[Element]) -> list[Operation]:
    """What is to be done so that a scene is like another one.

    :param present: all elements of the scene that is to be changed, each with its relations.
    """
    there = {element.id: element for element in present}
    gone = [eid for eid in there if eid not in scene and eid != ROOT]
    operations: list[Operation] = [Remove(eid, recursive=False) for eid in gone]
    for node in scene:
        element = Element.shared(node.type, node.label, node.id, node.properties, ())
        before = there.get(node.id)
        if before is None:
            operations.append(Add(element))
        elif not _same(before, element):
            operations.append(Update(element, relations=False))
    facts = {
        (e.id, r["type"], r["dst"])
        for e in present
        for r in e._rels
        if r["src"] == "-1" and not {e.id, r["dst"]} & {*gone}
    }
    wanted = set(scene.relations())
    operations += [Relate(*fact, value=False) for fact in sorted(facts - wanted)]
    return operations + [Relate(*fact) for fact in sorted(wanted - facts)]


def _same(one: Element, other: Element) -> bool:
    return (one.type, one.label) == (other.type, other.label) and all(
        _same_values(one._props.get(key), other._props.get(key)) for key in {*one._props, *other._props}
    )


def _same_values(one: Property | None, other: Property | None) -> bool:
    values, others = (prop.values if prop is not None else [] for prop in (one, other))
    return len(values) == len(others) and all(map(same_value, values, others))
