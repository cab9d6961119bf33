"""Poses of elements without tf: reading, writing, composition."""

from __future__ import annotations

from skiros2_common.core.world_element import Element

#: x, y, z (m) and a unit quaternion x, y, z, w.
Pose = tuple[float, float, float, float, float, float, float]

POSE_PROPERTIES = (
    "skiros:PositionX",
    "skiros:PositionY",
    "skiros:PositionZ",
    "skiros:OrientationX",
    "skiros:OrientationY",
    "skiros:OrientationZ",
    "skiros:OrientationW",
)


def get_pose(element: Element) -> Pose | None:
    """Returns the pose of an element in its parent's frame; None if a part is missing."""
    values = [element.value_of(key) for key in POSE_PROPERTIES]
    if any(value is None for value in values):
        return None
    x, y, z, qx, qy, qz, qw = (float(value) for value in values)
    return x, y, z, qx, qy, qz, qw


def set_pose(element: Element, pose: Pose) -> None:
    """Sets the pose of an element in its parent's frame. Does not write to the world model."""
    for key, value in zip(POSE_PROPERTIES, pose, strict=True):
        element.setProperty(key, value, "xsd:float")


def composed(outer: Pose, inner: Pose) -> Pose:
    """Returns a pose in the reference frame of `outer`, given `inner` in the frame at `outer`."""
    x, y, z, ax, ay, az, aw = outer
    dx, dy, dz = _rotated((ax, ay, az, aw), inner[:3])
    bx, by, bz, bw = inner[3:]
    return (
        x + dx,
        y + dy,
        z + dz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _rotated(
    quaternion: tuple[float, float, float, float], vector: tuple[float, float, float]
) -> tuple[float, float, float]:
    """v + 2w(u × v) + 2u × (u × v), with the quaternion's vector part u and scalar part w."""
    ux, uy, uz, w = quaternion
    x, y, z = vector
    tx, ty, tz = 2 * (uy * z - uz * y), 2 * (uz * x - ux * z), 2 * (ux * y - uy * x)
    return x + w * tx + uy * tz - uz * ty, y + w * ty + uz * tx - ux * tz, z + w * tz + ux * ty - uy * tx
