"""Applies published changes to a scene: for replicas and for recorded runs."""

from __future__ import annotations

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import REMOVE, REMOVE_RECURSIVE, RESET, Change
from skiros2_world_model.core.changeset import ChangeSet
from skiros2_world_model.core.scene import ElementRecord, Provenance, Scene


def apply_change(scene: Scene, change: Change) -> ChangeSet:
    """Applies a change to a scene and returns what it changed. It must be the next change; nothing is checked.

    A reset replaces the scene with its elements; a reset without elements empties it.
    """
    scene.begin()
    if change.action == RESET:
        scene.clear()
    if change.action in (REMOVE, REMOVE_RECURSIVE):
        for element in change.elements:
            if element.id in scene:
                scene.drop(element.id)
    else:
        for element in change.elements:
            scene.put(ElementRecord(element.id, element.type, element.label, element._props))
        for element in change.elements:
            _set_relations(scene, element, change.action == RESET)
    for relation in change.relations:
        ends = relation["src"], relation["type"], relation["dst"]
        if change.action in (REMOVE, REMOVE_RECURSIVE):
            scene.unrelate(*ends)
        else:
            scene.relate(*ends)
    return scene.commit(Provenance(change.number, change.stamp, change.author))


def _set_relations(scene: Scene, element: Element, is_reset: bool) -> None:
    """Replaces the relations of an element; in a reset, only adds its outgoing relations."""
    eid = element.id
    wanted = dict.fromkeys(
        (eid if r["src"] == "-1" else r["src"], r["type"], eid if r["dst"] == "-1" else r["dst"]) for r in element._rels
    )
    if not is_reset:
        for relation in [*scene.relations(eid), *scene.relations(dst=eid)]:
            if relation not in wanted:
                scene.unrelate(*relation)
    for relation in wanted:
        scene.relate(*relation)
