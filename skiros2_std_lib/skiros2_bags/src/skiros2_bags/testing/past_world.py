"""The scene as it was at a point of a recording, and recorded changes as requests."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from skiros2_bags.core.world_history import world_at
from skiros2_bags.testing.recording import Changed, Recording
from skiros2_common.core.world_element import Element, ElementChanges, RelationDict
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import (
    ADD,
    REMOVE,
    REMOVE_RECURSIVE,
    RESET,
    Add,
    Change,
    Operation,
    Patch,
    Relate,
    Remove,
    Update,
    relation_dict,
)
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.scene import ROOT, Scene
from skiros2_world_model.core.world_model import WorldModel

#: What skills have.
_MODULE = "skiros:PythonModule"

#: Who makes the scene that a replay begins with.
RECORDER = "recording"


def scene_before(recording: Recording, order: int) -> Scene:
    """The scene as it was when the bag's message of that number came; the first whole scene where that is later.

    :raises BagError: the bag has no whole scene, or changes are missing in it.
    """
    changes = recording.run.changes()
    past = {event.change.snapshot_id for event in recording.changes if event.order < order}
    known = sum(timed.change.snapshot_id in past for timed in changes)
    whole = next((number for number, timed in enumerate(changes, 1) if timed.change.action == RESET), 1)
    return world_at(changes[: max(known, whole)], math.inf)


def world_of(scene: Scene, workspace: Path | None) -> WorldModel:
    """A world model of its own with that scene.

    :param workspace: folder of further ontologies.
    """
    model = WorldModel(source_ontologies(), workspace)
    declaring = LocalWorldModel(RECORDER, model)
    for name in sorted({node.type for node in scene if _MODULE in node.properties}):
        declaring.add_class(name, "skiros:Skill")  # as its manager has: no file has them
    model.transact(whole_scene(scene, model.scene()), RECORDER)
    model.scene().reserve(scene.next_number)
    return model


def operations_of(change: Change, scene: Scene) -> list[Operation]:
    """What asks a world model for a change; for one of the ontologies, nothing.

    :param scene: as it is before.
    """
    if change.action in (REMOVE, REMOVE_RECURSIVE):
        removed = [Remove(e.id, recursive=False) for e in change.elements if e.id in scene]
        return [*removed, *_relates(change.relations, False)]
    written: list[Operation] = []
    for element in change.elements:
        given = _plain(element)
        written.append(Update(given) if element.id in scene else Add(given))
    return [*written, *_relates(change.relations, change.action == ADD)]


@functools.cache
def input_operations(recording: Recording) -> dict[int, list[Operation]]:
    """What makes each change of a recording where other changes may be missing: only what it made otherwise.

    :returns: by the order of the change.
    """
    scene = Scene()
    found: dict[int, list[Operation]] = {}
    for event in recording.changes:
        found[event.order] = _patches(event.change, scene)
        apply_change(scene, event.change)
    return found


def _patches(change: Change, scene: Scene) -> list[Operation]:
    known = [scene.element(e.id) for e in change.elements]
    if change.action in (REMOVE, REMOVE_RECURSIVE, RESET) or None in known:
        return operations_of(change, scene)
    patches: list[Operation] = []
    for before, element in zip(known, change.elements, strict=True):
        assert before is not None
        was, now = before._props, element._props
        came, went = _relations_of(element) - _relations_of(before), _relations_of(before) - _relations_of(element)
        changes = ElementChanges(
            {key: prop for key, prop in now.items() if key not in was or was[key].values != prop.values},
            [key for key in was if key not in now],
            [relation_dict(*relation) for relation in sorted(came)],
            [relation_dict(*relation) for relation in sorted(went)],
            element.label if element.label != before.label else None,
            element.type if element.type != before.type else None,
        )
        patches.append(Patch(element.id, changes))
    return [*patches, *_relates(change.relations, change.action == ADD)]


def _relations_of(element: Element) -> set[tuple[str, str, str]]:
    return {
        (element.id if r["src"] == "-1" else r["src"], r["type"], element.id if r["dst"] == "-1" else r["dst"])
        for r in element._rels
    }


def requests_of(events: Sequence[Changed]) -> list[list[Changed]]:
    """The changes that came of one request together: those that follow each other with the same author and stamp."""
    requests: list[list[Changed]] = []
    for event in events:
        last = requests[-1][-1].change if requests else None
        if last is not None and (last.author, last.stamp) == (event.change.author, event.change.stamp):
            requests[-1].append(event)
        else:
            requests.append([event])
    return requests


def whole_scene(scene: Scene, empty: Scene) -> list[Operation]:
    """What makes a scene of one that has at most a root."""
    elements = [scene.element(node.id) for node in scene]
    bare = [Element.shared(e.type, e.label, e.id, e._props, ()) for e in elements if e is not None]
    made: list[Operation] = [Update(e.copy()) if e.id in empty or e.id == ROOT else Add(e.copy()) for e in bare]
    return [*made, *(Relate(*relation) for relation in scene.relations())]


def _plain(element: Element) -> Element:
    """An element of a change, to be written whole."""
    made = Element(element.type, element.label, element.id)
    made._props = dict(element._props)
    made._rels = list(element._rels)
    return made


def _relates(relations: Iterable[RelationDict], value: bool) -> list[Operation]:
    return [Relate(r["src"], r["type"], r["dst"], value) for r in relations]
