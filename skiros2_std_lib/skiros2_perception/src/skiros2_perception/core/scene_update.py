"""Observations as changes of the world model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_perception.core import confidence
from skiros2_perception.core.association import Cluster
from skiros2_perception.core.objects import (
    KnownObject,
    known_object,
    put_colour,
    put_confidence,
    put_estimate,
)
from skiros2_perception.core.observation import Observation, cluster_estimate
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import ancestors, has_size

UNKNOWN = "skiros:UnknownObject"
MANIPULATABLE = "skiros:Manipulatable"
ROBOT = "cora:Robot"
#: Classes without a shape, even with a size.
_SHAPELESS = ("skiros:TransformationPose", "skiros:Scene", "skiros:DepthCamera")
_REASONER = "AauSpatialReasoner"


class SceneObjects(NamedTuple):
    """The objects of the world model that a view is compared with.

    :param known: movable, of a known shape.
    :param fixed: not movable.
    :param measured: added by perception.
    :param problems: why others cannot be used.
    """

    known: list[KnownObject]
    fixed: list[KnownObject]
    measured: list[KnownObject]
    problems: list[str]


class SceneUpdate(NamedTuple):
    """The changes by an observation: labels or ids of elements."""

    seen: list[str]
    missed: list[str]
    missing: list[str]
    added: list[str]
    removed: list[str]

    def __str__(self) -> str:
        parts = [f"{len(self.seen)} objects in view"]
        for word, names in (
            ("not seen", self.missed),
            ("missing", self.missing),
            ("new", self.added),
            ("removed", self.removed),
        ):
            if names:
                parts.append(f"{word}: {', '.join(names)}")
        return "; ".join(parts)


def scene_objects(wmi: WorldModelPort, kind: str = MANIPULATABLE) -> SceneObjects:
    """Returns the objects with a size. Parts of robots, and things that they hold, are omitted.

    :param kind: class of the movable objects that are looked for; movable objects of other classes are omitted.
    """
    found = SceneObjects([], [], [], [])
    for element in sorted(wmi.get_scene_elements(), key=lambda e: e.id):
        if not has_size(element) or any(wmi.is_subclass(element.type, c) for c in _SHAPELESS):
            continue
        if any(wmi.is_subclass(above.type, ROBOT) for above in ancestors(wmi, element)):
            continue
        if wmi.is_subclass(element.type, UNKNOWN):
            target = found.measured
        elif wmi.is_subclass(element.type, kind):
            target = found.known
        elif wmi.is_subclass(element.type, MANIPULATABLE):
            continue
        else:
            target = found.fixed
        try:
            target.append(known_object(wmi, element))
        except SkirosError as error:
            found.problems.append(str(error))
    return found


def update_scene(wmi: WorldModelPort, observation: Observation, objects: SceneObjects, place: str) -> SceneUpdate:
    """Writes an observation to the world model.

    :param place: id of the element that contains new objects.
    :raises SkirosError: the world model refuses a change.
    """
    before = {thing.id: thing for thing in (*objects.known, *objects.measured)}
    update = SceneUpdate([], [], [], [], [])
    changed = [*_seen(wmi, observation, before, update)]
    removed = []
    for eid, part in observation.absent:
        value = confidence.not_seen(before[eid].confidence, part)
        element = wmi.get_element(eid)
        if value < confidence.REMOVED_BELOW and wmi.is_subclass(element.type, UNKNOWN):
            removed.append(element)
            update.removed.append(_name(element))
            continue
        put_confidence(element, value)
        changed.append(element)
        (update.missing if value < confidence.MISSING_BELOW else update.missed).append(_name(element))
    if changed:
        wmi.update_elements(changed)
    for element in removed:
        wmi.remove_element(element)
    new = [_new_element(wmi, cluster, place, observation.stamp) for cluster in observation.unknown]
    if new:
        update.added.extend(element.id for element in wmi.add_elements(new))
    return update


def _seen(
    wmi: WorldModelPort, observation: Observation, before: dict[str, KnownObject], update: SceneUpdate
) -> Iterator[Element]:
    for seen in observation.seen:
        element = wmi.get_element(seen.id)
        put_confidence(element, confidence.seen(before[seen.id].confidence, seen.part))
        put_colour(element, seen.colour)
        if seen.estimate is not None and not space.text(element, space.LINKED_TO):
            put_estimate(wmi, element, seen.estimate)
        if seen.cluster is not None:
            space.set_numbers(element, space.SIZE, seen.cluster.size)
        update.seen.append(_name(element))
        yield element


def _new_element(wmi: WorldModelPort, cluster: Cluster, place: str, stamp: float) -> Element:
    """Returns an element for an unknown thing, in a place."""
    element = Element(UNKNOWN, "Unknown object")
    element.addRelation(place, "skiros:contain", "-1")
    element.setProperty("skiros:DiscreteReasoner", _REASONER)
    parent = wmi.get_element(place)
    space.set_text(element, space.BASE_FRAME, space.text(parent, space.FRAME) or parent.id)
    space.set_numbers(element, space.SIZE, cluster.size)
    put_estimate(wmi, element, cluster_estimate(cluster, stamp))
    put_confidence(element, confidence.NEW)
    put_colour(element, cluster.colour)
    return element


def _name(element: Element) -> str:
    return element.label or element.id
