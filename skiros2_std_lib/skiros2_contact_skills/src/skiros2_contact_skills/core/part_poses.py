"""Poses of parts, bores and tools, from the world model. Metres."""

from __future__ import annotations

import math

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.geometry import (
    IDENTITY,
    Pose,
    Quaternion,
    Vector,
    composed,
    cross,
    inverted,
    multiplied,
    normalized,
    rotated,
)
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.scene_poses import parent_of, pose_in_scene, size_of

#: The orientation of a tool in the frame of what it points at from above: half a turn about x.
_DOWN: Quaternion = (1.0, 0.0, 0.0, 0.0)


def pose_on_arm(wmi: WorldModelPort, arm: Element, element: Element) -> Pose:
    """Returns the pose of an element in the base frame of an arm.

    :raises WrongValue: one of them, or an ancestor, has no pose.
    """
    return composed(inverted(pose_in_scene(wmi, arm)[1]), pose_in_scene(wmi, element)[1])


def held_frame(wmi: WorldModelPort, part: Element | None, feature: Element | None = None) -> Pose:
    """Returns the frame at the lower end of a held part, in the tool frame; z points back into the hand.

    :param part: in a gripper; None: the tool itself.
    :param feature: a frame of the part, in place of that at its lower end.
    :raises WrongValue: the part is not in a gripper, or it has no pose or size.
    """
    if part is None:
        return Pose(IDENTITY.position, _DOWN)
    holder, pose = parent_of(wmi, part), space.pose_of(part)
    if holder is None or pose is None or not wmi.is_subclass(holder.type, "rparts:GripperEffector"):
        raise WrongValue(f"{part.label!r} is not in a gripper")
    if feature is not None:
        on_part = space.pose_of(feature)
        if on_part is None:
            raise WrongValue(f"{feature.label!r} has no pose")
        return composed(pose, on_part)
    return composed(pose, Pose((0.0, 0.0, -size_of(part)[2] / 2.0), IDENTITY.orientation))


def aligned_tool(tool: Pose, end: Pose, target: Pose, height: float) -> Pose:
    """Returns the tool pose at which the lower end of a part is above a target, with both z axes aligned by the
    smallest rotation of the tool.

    :param tool: current pose; `target` is in the same frame.
    :param end: in the tool frame.
    :param height: along z of the target.
    """
    has = rotated(multiplied(tool.orientation, end.orientation), (0.0, 0.0, 1.0))
    wants = rotated(target.orientation, (0.0, 0.0, 1.0))
    orientation = multiplied(smallest_rotation(has, wants), tool.orientation)
    offset = rotated(orientation, end.position)
    x, y, z = (point + axis * height - off for point, axis, off in zip(target.position, wants, offset, strict=True))
    return Pose((x, y, z), normalized(orientation))


def depth_and_tilt(rim: Pose, part: Pose, height: float) -> tuple[float, float]:
    """Returns the depth of the lower end of a part below a rim (m), and the angle between their axes (rad).

    :param rim: pose of a bore, z out of it.
    :param part: pose of the middle of the part, in the same frame.
    :param height: of the part (m).
    """
    lower = composed(part, Pose((0.0, 0.0, -height / 2.0), IDENTITY.orientation))
    inside = composed(inverted(rim), lower)
    upright = rotated(inside.orientation, (0.0, 0.0, 1.0))[2]
    return -inside.position[2], math.acos(max(-1.0, min(1.0, upright)))


def smallest_rotation(a: Vector, b: Vector) -> Quaternion:
    """Returns the smallest rotation of the unit vector `a` to the unit vector `b`; half a turn is about any axis."""
    cosine = sum(x * y for x, y in zip(a, b, strict=True))
    if cosine < -1.0 + 1e-9:
        other = (1.0, 0.0, 0.0) if abs(a[0]) < 0.9 else (0.0, 1.0, 0.0)
        x, y, z = cross(a, other)
        length = math.hypot(x, y, z)
        return x / length, y / length, z / length, 0.0
    x, y, z = cross(a, b)
    return normalized((x, y, z, 1.0 + cosine))
