"""Regions that the tool of an arm does not enter, as repulsive planes.

At each moment a region is the plane through its point that is nearest to the tool, with the normal n out of it, at the
distance d. Within `MARGIN` before the plane, a wrench f of the arm loses its part into the plane in proportion to the
depth, and a spring and a damper push back:

    f' = f - (1 - d / MARGIN) min(0, f n) n + n (WALL_STIFFNESS (MARGIN - d) - WALL_DAMPING min(0, v n))

So the arm itself never presses a resting tool through the plane, and WALL_STIFFNESS x MARGIN = 120 N from outside push
it there. (Khatib, Real-Time Obstacle Avoidance for Manipulators and Mobile Robots, 1986; virtual fixtures: Rosenberg,
1993.) All regions are convex: each of them is on one side of its plane. Pure computation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.geometry import Pose, Vector, conjugated, rotated

Array = npt.NDArray[np.float64]

#: Distance from a region within which it repels the tool (m), stiffness (N/m) and damping (Ns/m) there, and the largest
#: force (N), also inside.
MARGIN, WALL_STIFFNESS, WALL_DAMPING = 0.03, 4000.0, 200.0
WALL_FORCE = MARGIN * WALL_STIFFNESS


class Region(NamedTuple):
    """A box around the origin of its frame; a cylinder about z around it; or the half-space below z = 0.

    :param name: for people.
    :param pose: of its frame, in the base frame of the arm.
    :param size: edges of the box, or diameter, diameter and height of the cylinder (m); () for the half-space.
    """

    name: str
    pose: Pose
    size: tuple[float, ...] = ()
    is_round: bool = False

    def plane(self, point: Sequence[float]) -> tuple[float, Vector]:
        """Returns the distance of a point in the base frame (m), negative inside, and the normal there, a unit vector
        in the base frame."""
        origin, orientation = self.pose
        x, y, z = rotated(conjugated(orientation), [a - b for a, b in zip(point, origin, strict=True)])
        if not self.size:
            return z, rotated(orientation, (0.0, 0.0, 1.0))
        if self.is_round:
            radius = math.hypot(x, y)
            distance, (out, up) = _nearest((radius, z), (self.size[0] / 2.0, self.size[2] / 2.0))
            cosine, sine = (x / radius, y / radius) if radius > 0.0 else (1.0, 0.0)
            return distance, rotated(orientation, (out * cosine, out * sine, up))
        distance, (nx, ny, nz) = _nearest((x, y, z), [edge / 2.0 for edge in self.size])
        return distance, rotated(orientation, (nx, ny, nz))

    def has_inside(self, point: Sequence[float]) -> bool:
        """Whether a point in the base frame is inside."""
        return self.plane(point)[0] < 0.0


def repelled(force: Array, point: Sequence[float], velocity: Array, regions: Iterable[Region]) -> Array:
    """Returns the force that the tool exerts in place of one that would press it into regions (N).

    :param force: of spring and commanded wrench, in the base frame.
    :param point: of the tool, in the base frame (m).
    :param velocity: of the tool (m/s).
    """
    for region in regions:
        distance, normal = region.plane(point)
        depth = MARGIN - distance
        if depth <= 0.0:
            continue
        out = np.array(normal)
        force = force - min(1.0, depth / MARGIN) * min(0.0, float(force.dot(out))) * out
        push = WALL_STIFFNESS * depth - WALL_DAMPING * min(0.0, float(velocity.dot(out)))
        force = force + min(push, WALL_FORCE) * out
    return force


def kept_out(reference: Pose, tool: Pose, stiffness: Sequence[float], regions: Iterable[Region]) -> Pose:
    """Returns the nearest reference that keeps a spring between it and the tool from pulling the tool into regions, and
    pushes a tool that is within the margin back: for drivers whose law does not know regions.

    :param stiffness: of the spring, along the axes of the tool (N/m).
    """
    x, y, z = reference.position
    weakest = max(min(stiffness[:3]), 50.0)
    for region in regions:
        distance, (nx, ny, nz) = region.plane(tool.position)
        depth = MARGIN - distance
        least = min(depth * WALL_STIFFNESS, WALL_FORCE) / weakest if depth > 0.0 else depth
        ahead = sum(n * (a - b) for n, a, b in zip((nx, ny, nz), (x, y, z), tool.position, strict=True))
        if ahead < least:
            more = least - ahead
            x, y, z = x + more * nx, y + more * ny, z + more * nz
    return Pose((x, y, z), reference.orientation)


def _nearest(point: Sequence[float], half: Sequence[float]) -> tuple[float, list[float]]:
    """Returns the distance of a point from a box around the origin, negative inside, and the normal there."""
    beyond = [abs(value) - edge for value, edge in zip(point, half, strict=True)]
    signs = [math.copysign(1.0, value) for value in point]
    length = math.hypot(*(max(value, 0.0) for value in beyond))
    if length > 0.0:
        return length, [sign * max(value, 0.0) / length for sign, value in zip(signs, beyond, strict=True)]
    nearest = max(beyond)
    face = beyond.index(nearest)
    return nearest, [sign if axis == face else 0.0 for axis, sign in enumerate(signs)]
