"""Poses of things in the scene, and poses for grasping and placing them. Metres, in the frame of the scene."""

from __future__ import annotations

import math
from typing import NamedTuple

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import (
    Pose,
    Quaternion,
    Vector,
    composed,
    half_extents,
    inverted,
    multiplied,
    rotated,
)
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import SPATIAL, parent_of, pose_in_scene, size_of

CONTAIN = "skiros:contain"
CONTAINER_STATE = "skiros:ContainerState"

#: Maximum distance from the fingertips to the top of a grasped object, limited by the hand (m).
_GRASP_DEPTH = 0.04
#: Edges that differ by less are equivalent for grasping (m).
_EQUAL = 0.003
#: Orientation of a tool that points down: half a turn about x.
_DOWN: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Box(NamedTuple):
    """Pose of the centre, and edge lengths (m)."""

    pose: Pose
    size: Vector


def box_of(wmi: WorldModelPort, element: Element) -> Box:
    """Returns pose and size of an element.

    :raises WrongValue: it has no pose or no size.
    """
    return Box(pose_in_scene(wmi, element)[1], size_of(element))


def approach_pose(wmi: WorldModelPort, place: Element) -> tuple[str, Pose]:
    """Returns the pose of a robot at a place: its `skiros:ApproachPose`; without one, the pose of the place."""
    for relation in place.getRelations("-1", "skiros:hasA"):
        part: Element = wmi.get_element(relation["dst"])
        if wmi.is_subclass(part.type, "skiros:ApproachPose"):
            return pose_in_scene(wmi, part)
    return pose_in_scene(wmi, place)


def grasp_of(thing: Box, ahead: Vector, opening: float = math.inf) -> Pose:
    """Returns the tool pose for grasping an object from above, with the fingers across its narrower side.

    :param ahead: of equivalent poses, selects the one with the tool's x axis nearest to this direction.
    :param opening: maximum width of the gripper (m).
    :raises WrongValue: the object is too wide.
    """
    axes = [rotated(thing.pose.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    upright = max(range(3), key=lambda i: abs(axes[i][2]))
    level = [i for i in range(3) if i != upright]
    narrow = min(thing.size[i] for i in level)
    if narrow >= opening:
        raise WrongValue(f"the object is {narrow * 1000:.0f} mm wide, but the gripper opens to {opening * 1000:.0f} mm")
    # the fingers close along y, so x is along the other horizontal edge
    directions = [axes[b] for a, b in (level, level[::-1]) if thing.size[a] <= narrow + _EQUAL]
    x, y, z = thing.pose.position
    half = half_extents(thing.pose.orientation, thing.size)[2]
    return Pose((x, y, max(z, z + half - _GRASP_DEPTH)), _pointing_down(directions, ahead))


def release_of(container: Box, thing: Box, ahead: Vector) -> Pose:
    """Returns the tool pose for releasing an object in the middle of a container.

    :param thing: the object, with its pose in the tool frame.
    """
    axes = [rotated(container.pose.orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    turn = _pointing_down(axes, ahead)
    top = container.pose.position[2] + half_extents(container.pose.orientation, container.size)[2]
    half = half_extents(multiplied(turn, thing.pose.orientation), thing.size)[2]
    dx, dy, dz = rotated(turn, thing.pose.position)
    x, y, _ = container.pose.position
    return Pose((x - dx, y - dy, top + half - dz), turn)


def in_grasp(thing: Box, grasp: Pose) -> Pose:
    """Returns the pose of a grasped object in the tool frame, centred between the fingers."""
    position, orientation = composed(inverted(grasp), thing.pose)
    return Pose((position[0], 0.0, position[2]), orientation)


def above(pose: Pose, height: float) -> Pose:
    """Returns a pose vertically above another one."""
    x, y, z = pose.position
    return Pose((x, y, z + height), pose.orientation)


def is_on(thing: Box, ground: Box) -> bool:
    """Whether an object stands on a box, or on something on it."""
    position, turn = composed(inverted(ground.pose), thing.pose)
    foot = position[2] - half_extents(turn, thing.size)[2] - ground.size[2] / 2
    inside = all(abs(position[i]) <= ground.size[i] / 2 for i in range(2))
    return inside and -0.03 <= foot <= 0.15


def move_in_world_model(wmi: WorldModelPort, thing: Element, holder: Element, pose: Pose) -> None:
    """Moves a thing in the world model, and updates the states of both containers.

    :param pose: in the frame of the holder.
    :raises SkirosError: the world model rejects a change.
    """
    moved: Element = wmi.get_element(thing.id)
    before = parent_of(wmi, moved)
    moved.removeRelations(moved.getRelations("", SPATIAL, "-1"))
    moved.addRelation(holder.id, CONTAIN, "-1")
    space.set_pose(moved, pose)
    space.set_text(moved, space.BASE_FRAME, space.text(holder, space.FRAME) or str(holder.id))
    wmi.update_element(moved)
    for place in {before.id if before is not None else "", holder.id} - {""}:
        _update_container_state(wmi, wmi.get_element(place))


def contents(wmi: WorldModelPort, container: Element) -> list[Element]:
    """Returns the elements that an element contains."""
    return [wmi.get_element(r["dst"]) for r in container.getRelations("-1", CONTAIN)]


def _update_container_state(wmi: WorldModelPort, container: Element) -> None:
    state = "Full" if container.getRelations("-1", CONTAIN) else "Empty"
    if container.value_of(CONTAINER_STATE) not in (None, state):
        container.setProperty(CONTAINER_STATE, state)
        wmi.update_element_properties(container)


def _pointing_down(directions: list[Vector], ahead: Vector) -> Quaternion:
    """Returns the orientation of a tool that points down, with x along one of the directions, or opposite to it."""

    def along(direction: Vector) -> float:
        return direction[0] * ahead[0] + direction[1] * ahead[1]

    x, y, _ = max((v for d in directions for v in (d, (-d[0], -d[1], -d[2]))), key=along)
    yaw = math.atan2(y, x)
    return multiplied((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), _DOWN)


def direction_between(start: Pose, end: Pose) -> Vector:
    """Returns the horizontal direction from one pose to another, not normalised."""
    return end.position[0] - start.position[0], end.position[1] - start.position[1], 0.0
