"""What it means for the world model that a camera sees some things and not others."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_sim_skills.core.places import (
    Box,
    box_of,
    contents,
    has_size,
    holder_of,
    is_on,
    line_above,
    pose_in_scene,
    size_of,
)
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, composed, inverted

log = logging.getLogger(__name__)

MANIPULATABLE = "skiros:Manipulatable"
GRIPPER = "rparts:EndEffector"

#: What is seen nearer to the gripper that holds it is still held (m).
_IN_HAND = 0.12


class Place(NamedTuple):
    """Something that things may lie in, the pose of it in the scene, and the box that they stand on then."""

    element: Element
    pose: Pose
    ground: Box


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
    scene = line_above(wmi, workstation)[-1]
    found = []
    for eid, pose in seen.items():
        thing = wmi.get_element(eid) if wmi.is_scene_element(eid) else None
        if thing is None or not wmi.is_subclass(thing.type, MANIPULATABLE):
            continue
        before = holder_of(wmi, thing)
        if before is not None and wmi.is_subclass(before.type, GRIPPER) and _is_near(wmi, before, pose):
            continue
        box = Box(pose, size_of(thing) if has_size(thing) else (0.0, 0.0, 0.0))
        holder, base = next(((p.element, p.pose) for p in places if is_on(box, p.ground)), (scene, IDENTITY))
        found.append(Finding(thing, holder, composed(inverted(base), pose), before, True))
    for thing in expected_at(wmi, workstation):
        if thing.id not in seen:
            found.append(Finding(thing, scene, pose_in_scene(wmi, thing)[1], holder_of(wmi, thing), False))
    return found


def _places(wmi: Any) -> list[Place]:
    """What things may lie in, the smallest first: a tray before the table top that it stands on."""
    places = []
    for element in wmi.resolve_elements(Element("skiros:Container")):
        # A table top has no size: it is the top of what it hangs on.
        sized = element if has_size(element) else holder_of(wmi, element)
        try:
            if sized is not None:
                places.append(Place(element, pose_in_scene(wmi, element)[1], box_of(wmi, sized)))
        except WrongValue as error:
            log.warning("nothing is seen to lie in %r: %s", element, error)
    return sorted(places, key=lambda place: place.ground.size[0] * place.ground.size[1])


def _is_near(wmi: Any, gripper: Element, pose: Pose) -> bool:
    return math.dist(pose_in_scene(wmi, gripper)[1].position, pose.position) < _IN_HAND
