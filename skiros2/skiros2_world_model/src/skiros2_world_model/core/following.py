"""A scene that is kept up to date from what is told of its changes: a client's replica, and what is read from a bag."""

from __future__ import annotations

from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import REMOVE, REMOVE_RECURSIVE, RESET, Change
from skiros2_world_model.core.scene import Node, Provenance, Scene


def follow(scene: Scene, change: Change) -> None:
    """Makes in a scene what a change tells. It must be the next one: nothing is checked.

    A reset that has elements tells the whole scene; one without leaves it empty.
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
            scene.put(Node(element.id, element.type, element.label, element._props))
        for element in change.elements:
            _set_relations(scene, element, change.action == RESET)
    for relation in change.relations:
        ends = relation["src"], relation["type"], relation["dst"]
        if change.action in (REMOVE, REMOVE_RECURSIVE):
            scene.unrelate(*ends)
        else:
            scene.relate(*ends)
    scene.commit(Provenance(change.number, change.stamp, change.author))


def _set_relations(scene: Scene, element: Element, is_reset: bool) -> None:
    """Gives an element exactly the relations that it has in a change; of a whole scene each tells its outgoing ones."""
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
