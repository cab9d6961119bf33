"""Restores the scene of a world model from a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from skiros2_common.core.operations import Add, Operation, Relate, Remove, Update
from skiros2_common.core.property import Property, same_value
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.scene import ROOT, Scene


class SceneEditor(Protocol):
    """The calls of a world model's client that restoring uses."""

    def resolve_elements(self, description: Element, /) -> Sequence[Element]: ...
    def transact(self, operations: Sequence[Operation], /) -> object: ...


@dataclass(frozen=True)
class Restored:
    """Numbers of elements added, changed and removed."""

    added: int
    changed: int
    removed: int


def restore(wm: SceneEditor, scene: Scene) -> Restored:
    """Replaces the scene of a world model, in one transaction.

    Elements keep their ids. The skills that running skill managers have registered are replaced too.

    :raises WmException: the world model does not answer, or rejects the scene: a name is not in its ontologies, for
        example.
    """
    operations = restore_operations(scene, wm.resolve_elements(Element("")))
    if operations:
        wm.transact(operations)
    kinds = [sum(isinstance(o, kind) for o in operations) for kind in (Add, Update, Remove)]
    return Restored(*kinds)


def restore_operations(scene: Scene, elements: Sequence[Element]) -> list[Operation]:
    """Returns the operations that turn one scene into another.

    :param elements: all elements of the scene to change, each with its relations.
    """
    current = {element.id: element for element in elements}
    removed = [eid for eid in current if eid not in scene and eid != ROOT]
    operations: list[Operation] = [Remove(eid, recursive=False) for eid in removed]
    for node in scene:
        element = Element.shared(node.type, node.label, node.id, node.properties, ())
        before = current.get(node.id)
        if before is None:
            operations.append(Add(element))
        elif not _same(before, element):
            operations.append(Update(element, relations=False))
    facts = {
        (e.id, r["type"], r["dst"])
        for e in elements
        for r in e.relation_view
        if r["src"] == "-1" and not {e.id, r["dst"]} & {*removed}
    }
    wanted = set(scene.relations())
    operations += [Relate(*fact, value=False) for fact in sorted(facts - wanted)]
    return operations + [Relate(*fact) for fact in sorted(wanted - facts)]


def _same(one: Element, other: Element) -> bool:
    return (one.type, one.label) == (other.type, other.label) and all(
        _same_values(one.property_view.get(key), other.property_view.get(key))
        for key in {*one.property_view, *other.property_view}
    )


def _same_values(one: Property | None, other: Property | None) -> bool:
    values, others = (prop.values if prop is not None else [] for prop in (one, other))
    return len(values) == len(others) and all(map(same_value, values, others))
