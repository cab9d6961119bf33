"""Bounds the lead of a reference over the tool, for drivers whose law does not do it.

With the stiffness K, the wrench F and the limits of force and torque, the lead e stays so short that
|K e + F| <= limit, along and about the axes of the tool, and for each axis that has a limit of its own. An impedance
controller then presses with at most the limit at rest, whatever its sensor measures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from skiros2_motion.core.geometry import Pose, between, composed, conjugated, multiplied, rotated, rotation_of
from skiros2_motion.core.impedance import rotation_vector
from skiros2_motion.core.wrench_guard import Limits


def bounded_reference(
    reference: Pose, tool: Pose, stiffness: Sequence[float], wrench: Sequence[float], limits: Limits
) -> Pose:
    """Returns the reference, or one that is within the limits: on the line from the tool to it, after its lead along
    and about axes with a limit of their own is shortened.

    :param tool: measured pose, in the frame of the reference.
    :param stiffness: along and about the axes of the tool (N/m, Nm/rad).
    :param wrench: commanded, along and about these axes (N, Nm).
    """
    back = conjugated(tool.orientation)
    lead = rotated(back, [a - b for a, b in zip(reference.position, tool.position, strict=True)])
    turn = rotated(back, rotation_vector(multiplied(reference.orientation, back)))
    if limits.axes:
        bounded = [_within(*each) for each in zip(stiffness, (*lead, *turn), wrench, limits.axes, strict=True)]
        if bounded != [*lead, *turn]:
            (x, y, z), (rx, ry, rz) = bounded[:3], bounded[3:]
            lead, turn = (x, y, z), (rx, ry, rz)
            reference = composed(tool, Pose(lead, rotation_of(turn)))
    part = _part_within(stiffness[:3], lead, wrench[:3], limits.force)
    angle = _part_within(stiffness[3:], turn, wrench[3:], limits.torque)
    if part == 1.0 and angle == 1.0:
        return reference
    return Pose(between(tool, reference, part).position, between(tool, reference, angle).orientation)


def _within(stiffness: float, lead: float, wrench: float, limit: float) -> float:
    """Returns the lead nearest to a given one with |K e + F| <= limit; 0 if the wrench alone is above it."""
    if not limit or abs(stiffness * lead + wrench) <= limit:
        return lead
    if abs(wrench) >= limit or not stiffness:
        return 0.0
    return (math.copysign(limit, stiffness * lead + wrench) - wrench) / stiffness


def _part_within(stiffness: Sequence[float], lead: Sequence[float], wrench: Sequence[float], limit: float) -> float:
    """Returns the largest s up to 1 with |s K e + F| <= limit; 0 if there is none."""
    spring = [k * e for k, e in zip(stiffness, lead, strict=True)]
    a, b = math.fsum(v * v for v in spring), math.fsum(v * w for v, w in zip(spring, wrench, strict=True))
    c = math.fsum(w * w for w in wrench) - limit * limit
    if not limit or a + 2.0 * b + c <= 0.0:
        return 1.0
    return (math.sqrt(b * b - a * c) - b) / a if c < 0.0 < a else 0.0
