"""Rotations between boxes, up to their symmetry."""

from __future__ import annotations

from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, angle_between, conjugated, multiplied
from skiros2_sim.core.perception import least_turned


def turn_between(a: Pose, b: Pose, size: Vector) -> float:
    """The smallest angle (rad) between two boxes of this size (m), up to their symmetry."""
    between = multiplied(conjugated(a.orientation), b.orientation)
    return angle_between(IDENTITY.orientation, least_turned(between, size))
