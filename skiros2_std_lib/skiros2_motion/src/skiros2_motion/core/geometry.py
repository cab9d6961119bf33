"""Poses: positions (x, y, z) in metres, unit quaternions (x, y, z, w)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Pose(NamedTuple):
    """Pose of a frame in another one: origin and orientation."""

    position: Vector
    orientation: Quaternion


IDENTITY = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def normalized(q: Sequence[float]) -> Quaternion:
    """Returns the unit quaternion; the identity for a zero quaternion."""
    x, y, z, w = q
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if length < 1e-12:
        return IDENTITY.orientation
    return x / length, y / length, z / length, w / length


def multiplied(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Returns the rotation `b` followed by the rotation `a` (the Hamilton product a b)."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugated(q: Sequence[float]) -> Quaternion:
    """Returns the inverse rotation."""
    x, y, z, w = q
    return -x, -y, -z, w


def rotated(q: Sequence[float], v: Sequence[float]) -> Vector:
    """Rotates a vector by a unit quaternion."""
    x, y, z, w = q
    vx, vy, vz = v
    # v + 2 u x (u x v + w v), with u the vector part
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """Return the cross product; that of NumPy takes 30 us."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def composed(outer: Pose, inner: Pose) -> Pose:
    """Returns a pose in frame A, given `inner` in frame B and the pose `outer` of B in A."""
    turned = rotated(outer.orientation, inner.position)
    ox, oy, oz = outer.position
    position = (ox + turned[0], oy + turned[1], oz + turned[2])
    return Pose(position, normalized(multiplied(outer.orientation, inner.orientation)))


def inverted(pose: Pose) -> Pose:
    """Returns the pose of A in B, given the pose of B in A."""
    back = conjugated(pose.orientation)
    x, y, z = rotated(back, pose.position)
    return Pose((-x, -y, -z), back)


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Returns the quaternion of rotations about the fixed axes x, y, z, in that order (rad)."""
    sr, cr = math.sin(roll / 2), math.cos(roll / 2)
    sp, cp = math.sin(pitch / 2), math.cos(pitch / 2)
    sy, cy = math.sin(yaw / 2), math.cos(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def to_euler(q: Sequence[float]) -> Vector:
    """Returns the rotations about the fixed axes x, y, z, in that order (rad); at a pitch of 90 degrees the roll is
    0."""
    x, y, z, w = normalized(q)
    sine = 2 * (w * y - z * x)
    if abs(sine) > 1 - 1e-12:
        pitch = math.copysign(math.pi / 2, sine)
        return 0.0, pitch, _wrapped(-2 * math.copysign(1.0, sine) * math.atan2(x, w))
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, math.asin(sine), yaw


def rotation_of(turn: Sequence[float]) -> Quaternion:
    """Returns the quaternion of a rotation vector (rad)."""
    angle = math.hypot(*turn)
    factor = math.sin(angle / 2.0) / angle if angle > 1e-9 else 0.5
    return turn[0] * factor, turn[1] * factor, turn[2] * factor, math.cos(angle / 2.0)


def angle_between(a: Sequence[float], b: Sequence[float]) -> float:
    """Returns the angle between two orientations (rad, 0 to pi)."""
    x, y, z, w = multiplied(conjugated(normalized(a)), normalized(b))
    return 2 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))


def between(start: Pose, end: Pose, part: float) -> Pose:
    """Returns the pose at a part (0 to 1) of a straight line with an even rotation in the shorter direction."""
    x, y, z, w = multiplied(conjugated(start.orientation), end.orientation)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    half = part * math.atan2(sine, w)
    scale = math.sin(half) / sine if sine > 1e-12 else part
    turn = multiplied(start.orientation, (scale * x, scale * y, scale * z, math.cos(half)))
    (ax, ay, az), (bx, by, bz) = start.position, end.position
    return Pose((ax + part * (bx - ax), ay + part * (by - ay), az + part * (bz - az)), normalized(turn))


def half_extents(orientation: Sequence[float], size: Sequence[float]) -> Vector:
    """Returns the half edge lengths of the axis-aligned bounding box of a rotated box."""
    columns = [rotated(orientation, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    x, y, z = (sum(abs(columns[j][i]) * size[j] / 2 for j in range(3)) for i in range(3))
    return x, y, z


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)
