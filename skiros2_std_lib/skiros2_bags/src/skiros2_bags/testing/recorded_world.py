"""Scenes of a recording, and recorded changes as requests."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from skiros2_bags.core.diff import unchanged_keys
from skiros2_bags.core.world_history import world_at
from skiros2_bags.testing.recording import Recording
from skiros2_common.core.discrete_reasoner import DiscreteReasoner, reasoners
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.operations import (
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
)
from skiros2_common.core.world_element import REASONER_PROPERTY, Element, ElementChanges, RelationDict
from skiros2_common.ros.reasoners import new_reasoners
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.reasoner_world_model import ReasonerWorldModel
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene
from skiros2_world_model.core.world_model import WorldModel

#: A property of skills.
_MODULE = "skiros:PythonModule"

#: Author of the initial scene of a replay.
AUTHOR = "recording"


def scene_before(recording: Recording, order: int) -> Scene:
    """Returns the scene before a message of the bag; the first whole scene, if that is later.

    :param order: number of the message.
    :raises BagError: the bag has no whole scene, or lacks changes.
    """
    changes = recording.run.changes()
    past = {event.change.snapshot_id for event in recording.changes if event.order < order}
    known = sum(timed.change.snapshot_id in past for timed in changes)
    whole = next((number for number, timed in enumerate(changes, 1) if timed.change.action == RESET), 1)
    return world_at(changes[: max(known, whole)], math.inf)


def world_model_with(scene: Scene, workspace: Path | None) -> WorldModel:
    """Returns a new world model with a scene.

    :param workspace: folder of additional ontologies.
    """
    model = WorldModel(source_ontologies(), workspace)
    declaring = LocalWorldModel(AUTHOR, model)
    for name in sorted({node.type for node in scene if _MODULE in node.properties}):
        declaring.add_class(name, "skiros:Skill")  # declared by the manager, not in a file
    empty, elements = model.scene(), [element for node in scene if (element := scene.element(node.id)) is not None]
    bare = [Element.shared(e.type, e.label, e.id, e.property_view, ()).copy() for e in elements]
    operations: list[Operation] = [Update(e) if e.id in empty else Add(e) for e in bare]
    model.transact([*operations, *(Relate(*relation) for relation in scene.relations())], AUTHOR)
    model.scene().reserve(scene.next_number)
    return model


def change_operations(change: Change, scene: Scene) -> list[Operation]:
    """Returns the operations that request a change; none for a change of the ontologies.

    :param scene: the scene before the change.
    """
    if change.action in (REMOVE, REMOVE_RECURSIVE):
        removed = [Remove(e.id, recursive=False) for e in change.elements if e.id in scene]
        return [*removed, *_relation_operations(change.relations, False)]
    written: list[Operation] = []
    for element in change.elements:
        given = _writable(element)
        written.append(Update(given) if element.id in scene else Add(given))
    return [*written, *_relation_operations(change.relations, change.action == ADD)]


@functools.cache
def input_operations(recording: Recording) -> dict[int, list[Operation]]:
    """Returns operations for each change that also apply to a scene that lacks other changes: only the differences.

    :returns: by the order of the change.
    """
    scene = Scene()
    found: dict[int, list[Operation]] = {}
    for event in recording.changes:
        found[event.order] = _patches(event.change, scene)
        apply_change(scene, event.change)
    return found


@functools.cache
def recorded_unchanged(recording: Recording) -> dict[int, dict[str, set[str]]]:
    """Returns what each recorded change has not written, see `unchanged_keys`, by the order of the change."""
    scene = Scene()
    found = {}
    for event in recording.changes:
        found[event.order] = unchanged_keys(event.change, scene)
        apply_change(scene, event.change)
    return found


def _patches(change: Change, scene: Scene) -> list[Operation]:
    known = [scene.element(e.id) for e in change.elements]
    if change.action in (REMOVE, REMOVE_RECURSIVE, RESET) or None in known:
        return change_operations(change, scene)
    patches: list[Operation] = []
    for before, element in zip(known, change.elements, strict=True):
        assert before is not None
        was, now = before.property_view, element.property_view
        added, removed = _relations_of(element) - _relations_of(before), _relations_of(before) - _relations_of(element)
        changes = ElementChanges(
            {key: prop for key, prop in now.items() if key not in was or was[key].values != prop.values},
            [key for key in was if key not in now],
            [relation_dict(*relation) for relation in sorted(added)],
            [relation_dict(*relation) for relation in sorted(removed)],
            element.label if element.label != before.label else None,
            element.type if element.type != before.type else None,
        )
        patches.append(Patch(element.id, changes))
    return [*patches, *_relation_operations(change.relations, change.action == ADD)]


def _relations_of(element: Element) -> set[tuple[str, str, str]]:
    return {
        (element.id if r["src"] == "-1" else r["src"], r["type"], element.id if r["dst"] == "-1" else r["dst"])
        for r in element.relation_view
    }


def _writable(element: Element) -> Element:
    """Copies an element of a change for writing."""
    content = dict(element.property_view), list(element.relation_view)
    return Element.with_content(element.type, element.label, element.id, *content)


def _relation_operations(relations: Iterable[RelationDict], value: bool) -> list[Operation]:
    return [Relate(r["src"], r["type"], r["dst"], value) for r in relations]


#: The packages of reasoners in the launch files.
PACKAGES = ("skiros2_std_reasoners",)


def add_reasoners(model: WorldModel, packages: Sequence[str] = PACKAGES) -> None:
    """Adds the reasoners that elements of the scene name, without their loops, whose changes are recorded.

    :param packages: packages of reasoners.
    :raises ConfigurationError: a package does not exist.
    """
    scene = model.scene()
    naming = (node.properties[REASONER_PROPERTY] for node in scene if REASONER_PROPERTY in node.properties)
    named = {name for prop in naming for name in prop.values}
    if not named:
        return
    for reasoner in new_reasoners(packages):
        name = reasoner.__class__.__name__
        if name in named:
            reasoners.add(reasoner)
            reasoner.init(ReasonerWorldModel(model))
            _add_without_defaults(model, reasoner)
            reasoner.run = lambda: None  # type: ignore[method-assign]
            reasoner.execute()


def _add_without_defaults(model: WorldModel, reasoner: DiscreteReasoner) -> None:
    """Adds a reasoner. The recorded elements have the default properties already that they had."""
    before = {node.id: set(node.properties) for node in model.scene()}
    model.add_reasoner(reasoner)
    added = {node.id: [key for key in node.properties if key not in before[node.id]] for node in model.scene()}
    patches = [Patch(eid, ElementChanges({}, keys, [], [], None, None)) for eid, keys in added.items() if keys]
    if patches:
        model.transact(patches, AUTHOR)
