"""What it means for the world model that a camera sees some things and not others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from skiros2_common.core.world_element import Element
from skiros2_sim_skills.core.places import (
    SCENE,
    Box,
    box_of,
    contents,
    distance_between,
    holder_of,
    is_on,
    pose_in_scene,
    size_of,
)
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, composed, inverted

MANIPULATABLE = "skiros:Manipulatable"
GRIPPER = "rparts:EndEffector"

#: What is seen nearer to the gripper that holds it is still held (m).
_IN_HAND = 0.12


class Place(NamedTuple):
    """Something that things may lie in, the pose of it in the scene, and the box that they stand on then."""

    element: Element
    pose: Pose
    ground: Box | None


class Finding(NamedTuple):
    """Where a thing is now: in which element, and its pose there. `seen` is False when it was looked for in vain."""

    thing: Element
    holder: Element
    pose: Pose
    before: Element | None
    seen: bool

    @property
    def is_news(self) -> bool:
        """Whether it is elsewhere than the world model says."""
        return self.before is None or self.before.id != self.holder.id

    def __str__(self) -> str:
        if not self.seen:
            return f"{self.thing.label} is not in {self.before.label if self.before else 'its place'} any more"
        where = f"in {self.holder.label}"
        return f"{self.thing.label} is {where}" if self.is_news else f"{self.thing.label} is still {where}"


def expected_at(wmi: Any, workstation: Element) -> list[Element]:
    """The things that lie on a workstation, as the world model says."""
    found, waiting = [], contents(wmi, workstation)
    while waiting:
        element = waiting.pop(0)
        if wmi.is_subclass(element.type, MANIPULATABLE):
            found.append(element)
        waiting += contents(wmi, element)
    return found


def findings(wmi: Any, workstation: Element, seen: Mapping[str, Pose]) -> list[Finding]:
    """What has to be told to the world model, for the things at a workstation and for all that were seen.

    What is held by a gripper, and seen there, is left alone. A thing that was not seen is somewhere in the scene.

    :param seen: the poses of things in the scene, by id; ids that the world model does not know are left out.
    """
    places = _places(wmi)
    (scene,) = wmi.resolve_elements(Element(SCENE))
    everywhere = Place(scene, IDENTITY, None)
    found = []
    for eid, pose in seen.items():
        thing = wmi.get_element(eid) if wmi.is_scene_element(eid) else None
        if thing is None or not wmi.is_subclass(thing.type, MANIPULATABLE):
            continue
        before = holder_of(wmi, thing)
        if before is not None and wmi.is_subclass(before.type, GRIPPER) and _is_near(wmi, before, pose):
            continue
        box = Box(pose, size_of(thing))
        place = next((p for p in places if p.ground is not None and is_on(box, p.ground)), everywhere)
        found.append(Finding(thing, place.element, composed(inverted(place.pose), pose), before, True))
    for thing in expected_at(wmi, workstation):
        if thing.id not in seen:
            found.append(Finding(thing, scene, pose_in_scene(wmi, thing)[1], holder_of(wmi, thing), False))
    return found


def _places(wmi: Any) -> list[Place]:
    """What things may lie in, the smallest first: a tray before the table top that it stands on."""
    places = []
    for element in wmi.resolve_elements(Element("skiros:Container")):
        holder = holder_of(wmi, element)
        if space.pose_of(element) is None or holder is None:
            continue
        # A table top has no size: it is the top of what it hangs on.
        sized = element if _has_size(element) else holder
        ground = box_of(wmi, sized) if _has_size(sized) else None
        places.append(Place(element, pose_in_scene(wmi, element)[1], ground))
    return sorted(places, key=lambda place: place.ground.size[0] * place.ground.size[1] if place.ground else 0.0)


def _has_size(element: Element) -> bool:
    return all(value is not None and value > 0 for value in space.numbers(element, space.SIZE))


def _is_near(wmi: Any, gripper: Element, pose: Pose) -> bool:
    return distance_between(pose_in_scene(wmi, gripper)[1], pose) < _IN_HAND
