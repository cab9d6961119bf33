"""Poses of elements in the scene, composed along the tree of the scene. Metres."""

from __future__ import annotations

import math

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, composed
from skiros2_std_reasoners.core import spatial_data as space

SCENE = "skiros:Scene"
#: The relations from a parent to its children.
SPATIAL = ["skiros:contain", "skiros:hasA"]


def ancestors(wmi: WorldModelPort, element: Element) -> list[Element]:
    """Returns an element and its ancestors, up to the root of the scene; the world model prevents cycles."""
    line = [element]
    while (above := parent_of(wmi, line[-1])) is not None:
        line.append(above)
    return line


def pose_in_scene(wmi: WorldModelPort, element: Element) -> tuple[str, Pose]:
    """Returns the frame of the scene, and the pose of an element in it.

    :raises WrongValue: the element, or an ancestor, has no pose.
    """
    line = ancestors(wmi, element)
    root, pose = line[-1], IDENTITY
    is_scene = wmi.is_subclass(root.type, SCENE)
    for below in line[: -1 if is_scene else None]:
        own = space.pose_of(below)
        if own is None:
            of = "" if below is element else f", an ancestor of {element.label!r},"
            raise WrongValue(f"{below.label!r}{of} has no pose")
        pose = composed(own, pose)
    return space.text(root, space.FRAME if is_scene else space.BASE_FRAME) or "map", pose


def has_size(element: Element) -> bool:
    """Whether all edge lengths of an element are known."""
    return all(value is not None and 0 < value < math.inf for value in space.numbers(element, space.SIZE))


def size_of(element: Element) -> Vector:
    """Returns the edge lengths of an element (m).

    :raises WrongValue: it has no size.
    """
    if not has_size(element):
        raise WrongValue(f"{element.label!r} has no size")
    x, y, z = (value or 0.0 for value in space.numbers(element, space.SIZE))
    return x, y, z


def parent_of(wmi: WorldModelPort, element: Element) -> Element | None:
    """Returns the parent of an element; None for the root."""
    above = element.getRelations("", SPATIAL, "-1")
    return wmi.get_element(above[0]["src"]) if above else None
