"""Interprets what a camera sees, and does not see, as changes of the world model."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import NamedTuple

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_std_reasoners.core.places import Box, box_of, contents, is_on
from skiros2_std_reasoners.core.scene_poses import ancestors, has_size, parent_of, pose_in_scene, size_of

log = logging.getLogger(__name__)

MANIPULATABLE = "skiros:Manipulatable"
GRIPPER = "rparts:EndEffector"

#: Maximum distance of a held object from its gripper (m).
_IN_HAND = 0.12


class Support(NamedTuple):
    """An element that can contain things: its pose in the scene, and the box that they stand on."""

    element: Element
    pose: Pose
    ground: Box


class Finding(NamedTuple):
    """Where a thing is: its container and its pose there. `seen` is False for an expected thing that was not
    detected."""

    thing: Element
    holder: Element
    pose: Pose
    before: Element | None
    seen: bool

    @property
    def is_change(self) -> bool:
        """Whether the container differs from the world model."""
        return self.before is None or self.before.id != self.holder.id

    def __str__(self) -> str:
        if not self.seen:
            return f"{self.thing.label} is no longer in {self.before.label if self.before else 'its place'}"
        where = f"in {self.holder.label}"
        return f"{self.thing.label} is {where}" if self.is_change else f"{self.thing.label} is still {where}"


def expected_at(wmi: WorldModelPort, workstation: Element) -> list[Element]:
    """Returns the things on a workstation according to the world model."""
    found, waiting = [], contents(wmi, workstation)
    while waiting:
        element = waiting.pop(0)
        if wmi.is_subclass(element.type, MANIPULATABLE):
            found.append(element)
        waiting += contents(wmi, element)
    return found


def findings(wmi: WorldModelPort, workstation: Element, seen: Mapping[str, Pose]) -> list[Finding]:
    """Returns the findings for the things at a workstation and all detected things.

    A thing that is held, and detected in the hand, is omitted. An undetected thing is moved to the scene.

    :param seen: poses of detected things in the scene, by id; unknown ids are ignored.
    """
    supports = _supports(wmi)
    scene = ancestors(wmi, workstation)[-1]
    found = []
    for eid, pose in seen.items():
        thing = wmi.get_element(eid) if wmi.is_scene_element(eid) else None
        if thing is None or not wmi.is_subclass(thing.type, MANIPULATABLE):
            continue
        before = parent_of(wmi, thing)
        if before is not None and wmi.is_subclass(before.type, GRIPPER) and _is_near(wmi, before, pose):
            continue
        box = Box(pose, size_of(thing) if has_size(thing) else (0.0, 0.0, 0.0))
        holder, base = next(((p.element, p.pose) for p in supports if is_on(box, p.ground)), (scene, IDENTITY))
        found.append(Finding(thing, holder, composed(inverted(base), pose), before, True))
    for thing in expected_at(wmi, workstation):
        if thing.id not in seen:
            found.append(Finding(thing, scene, pose_in_scene(wmi, thing)[1], parent_of(wmi, thing), False))
    return found


def _supports(wmi: WorldModelPort) -> list[Support]:
    """Returns the containers, the smallest first: a tray before the table it stands on."""
    supports = []
    for element in wmi.resolve_elements(Element("skiros:Container")):
        # a table top has no size of its own: the table has
        sized = element if has_size(element) else parent_of(wmi, element)
        try:
            if sized is not None:
                supports.append(Support(element, pose_in_scene(wmi, element)[1], box_of(wmi, sized)))
        except WrongValue as error:
            log.warning("%r is not used as a container: %s", element, error)
    return sorted(supports, key=lambda support: support.ground.size[0] * support.ground.size[1])


def _is_near(wmi: WorldModelPort, gripper: Element, pose: Pose) -> bool:
    return math.dist(pose_in_scene(wmi, gripper)[1].position, pose.position) < _IN_HAND
