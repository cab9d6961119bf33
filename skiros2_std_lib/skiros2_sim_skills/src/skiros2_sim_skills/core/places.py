"""Where the things of the scene are, and how a gripper takes and puts them. Metres, in the frame of the scene."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import (
    IDENTITY,
    Pose,
    Quaternion,
    Vector,
    composed,
    half_extents,
    inverted,
    multiplied,
    rotated,
)

SCENE = "skiros:Scene"
CONTAIN = "skiros:contain"
SPATIAL = ["skiros:contain", "skiros:hasA"]
CONTAINER_STATE = "skiros:ContainerState"

#: How far above the finger tips the top of what is grasped may be: there the hand begins, less some room (m).
_DEPTH_OF_GRASP = 0.04
#: Edges that differ by less are as good to grasp (m).
_ALIKE = 0.003
#: A tool that points straight down: half a turn about x.
_DOWN: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Box(NamedTuple):
    """Where the middle of a thing is in the scene, and its edges (m)."""

    pose: Pose
    size: Vector


def line_above(wmi: Any, element: Element) -> list[Element]:
    """An element, what it hangs on, and so on up to the root of the scene; the world model refuses circles."""
    line = [element]
    while (above := holder_of(wmi, line[-1])) is not None:
        line.append(above)
    return line


def pose_in_scene(wmi: Any, element: Element) -> tuple[str, Pose]:
    """The frame of the scene, and the pose of an element in it, by way of all that it hangs on.

    :raises WrongValue: the element, or something that it hangs on, has no pose.
    """
    line = line_above(wmi, element)
    root, pose = line[-1], IDENTITY
    is_scene = wmi.is_subclass(root.type, SCENE)
    for below in line[: -1 if is_scene else None]:
        own = space.pose_of(below)
        if own is None:
            of = "" if below is element else f", on which {element.label!r} hangs,"
            raise WrongValue(f"{below.label!r}{of} has no pose")
        pose = composed(own, pose)
    return space.text(root, space.FRAME if is_scene else space.BASE_FRAME) or "map", pose


def has_size(element: Element) -> bool:
    """Whether all edges of an element are known."""
    return all(value is not None and 0 < value < math.inf for value in space.numbers(element, space.SIZE))


def size_of(element: Element) -> Vector:
    """The edges of an element (m).

    :raises WrongValue: it has no size.
    """
    if not has_size(element):
        raise WrongValue(f"{element.label!r} has no size")
    x, y, z = (value or 0.0 for value in space.numbers(element, space.SIZE))
    return x, y, z


def box_of(wmi: Any, element: Element) -> Box:
    """Where an element is in the scene, and its size.

    :raises WrongValue: it has no pose or no size.
    """
    return Box(pose_in_scene(wmi, element)[1], size_of(element))


def approach_pose(wmi: Any, place: Element) -> tuple[str, Pose]:
    """Where a robot stands at a place: at its `skiros:ApproachPose`, or at the place itself where it has none."""
    for relation in place.getRelations("-1", "skiros:hasA"):
        part: Element = wmi.get_element(relation["dst"])
        if wmi.is_subclass(part.type, "skiros:ApproachPose"):
            return pose_in_scene(wmi, part)
    return pose_in_scene(wmi, place)


def holder_of(wmi: Any, element: Element) -> Element | None:
    """What an element hangs on; None for the root."""
    above = element.getRelations("", SPATIAL, "-1")
    return wmi.get_element(above[0]["src"]) if above else None


def grasp_of(thing: Box, ahead: Vector, opening: float = math.inf) -> Pose:
    """Where the tool takes a thing that lies somewhere, from above, with the fingers across its narrower side.

    :param ahead: of the ways that are alike, the one with the x axis of the tool nearest to this direction.
    :param opening: how far the fingers open (m).
    :raises WrongValue: the thing is too wide for that.
    """
    axes = [rotated(thing.pose.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    upright = max(range(3), key=lambda i: abs(axes[i][2]))
    level = [i for i in range(3) if i != upright]
    narrow = min(thing.size[i] for i in level)
    if narrow >= opening:
        raise WrongValue(f"it is {narrow * 1000:.0f} mm wide, and the gripper opens to {opening * 1000:.0f} mm")
    # The fingers close along y, so x is along the other level edge.
    directions = [axes[b] for a, b in (level, level[::-1]) if thing.size[a] <= narrow + _ALIKE]
    x, y, z = thing.pose.position
    half = half_extents(thing.pose.orientation, thing.size)[2]
    return Pose((x, y, max(z, z + half - _DEPTH_OF_GRASP)), _pointing_down(directions, ahead))


def release_of(container: Box, thing: Box, ahead: Vector) -> Pose:
    """Where the tool lets go of a thing, so that it stands in the middle of a container.

    :param thing: its pose is that in the frame of the tool.
    """
    axes = [rotated(container.pose.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    turn = _pointing_down(axes, ahead)
    top = container.pose.position[2] + half_extents(container.pose.orientation, container.size)[2]
    half = half_extents(multiplied(turn, thing.pose.orientation), thing.size)[2]
    dx, dy, dz = rotated(turn, thing.pose.position)
    x, y, _ = container.pose.position
    return Pose((x - dx, y - dy, top + half - dz), turn)


def in_grasp(thing: Box, grasp: Pose) -> Pose:
    """Where a thing is in the frame of the tool that has closed on it: the fingers have put it in their middle."""
    position, orientation = composed(inverted(grasp), thing.pose)
    return Pose((position[0], 0.0, position[2]), orientation)


def above(pose: Pose, height: float) -> Pose:
    """A pose straight above another one."""
    x, y, z = pose.position
    return Pose((x, y, z + height), pose.orientation)


def is_on(thing: Box, ground: Box) -> bool:
    """Whether a thing stands on a box, or on something that stands on it: above its top face, which it may touch."""
    position, turn = composed(inverted(ground.pose), thing.pose)
    foot = position[2] - half_extents(turn, thing.size)[2] - ground.size[2] / 2
    inside = all(abs(position[i]) <= ground.size[i] / 2 for i in range(2))
    return inside and -0.03 <= foot <= 0.15


def move_in_world_model(wmi: Any, thing: Element, holder: Element, pose: Pose) -> None:
    """Tells the world model that a thing is in another one now, and which of the two are full and empty.

    :param pose: in the frame of the holder.
    :raises SkirosError: the world model refuses.
    """
    moved: Element = wmi.get_element(thing.id)
    before = holder_of(wmi, moved)
    moved.removeRelations(moved.getRelations("", SPATIAL, "-1"))
    moved.addRelation(holder.id, CONTAIN, "-1")
    space.set_pose(moved, pose)
    space.set_text(moved, space.BASE_FRAME, space.text(holder, space.FRAME) or str(holder.id))
    wmi.update_element(moved)
    for place in {before.id if before is not None else "", holder.id} - {""}:
        _tell_content(wmi, wmi.get_element(place))


def contents(wmi: Any, container: Element) -> list[Element]:
    """What an element contains."""
    return [wmi.get_element(r["dst"]) for r in container.getRelations("-1", CONTAIN)]


def _tell_content(wmi: Any, container: Element) -> None:
    state = "Full" if container.getRelations("-1", CONTAIN) else "Empty"
    if container.value_of(CONTAINER_STATE) not in (None, state):
        container.setProperty(CONTAINER_STATE, state)
        wmi.update_element_properties(container)


def _pointing_down(directions: list[Vector], ahead: Vector) -> Quaternion:
    """The turn of a tool that points down, its x axis along one of the directions or against it."""

    def along(direction: Vector) -> float:
        return direction[0] * ahead[0] + direction[1] * ahead[1]

    x, y, _ = max((v for d in directions for v in (d, (-d[0], -d[1], -d[2]))), key=along)
    yaw = math.atan2(y, x)
    return multiplied((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), _DOWN)


def direction_between(start: Pose, end: Pose) -> Vector:
    """The level direction from one pose to another, not of unit length."""
    return end.position[0] - start.position[0], end.position[1] - start.position[1], 0.0
