"""The spatial relations between two boxes: one of Allen's on each axis, and equal or other orientation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_std_reasoners.core import allen
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, angle_between, half_extents

#: Lengths closer than this are equal (m), and angles (rad).
LENGTH_TOLERANCE = 0.001
ANGLE_TOLERANCE = 0.05

#: The answer when it is not known where the two are to each other.
UNKNOWN = ":unknownT"
SAME_ANGLE, OTHER_ANGLE = ":eqA", ":pA"

#: All relations that may be answered.
ALL = (*(f":{name}{axis}" for axis in "XYZ" for name in allen.RELATIONS), SAME_ANGLE, OTHER_ANGLE, UNKNOWN)


def relations_between(
    relative: Pose | None, subject_size: Sequence[float], object_size: Sequence[float]
) -> list[tuple[str, Any]]:
    """The relations from a subject to an object, each with its distance or distances (m, rad).

    :param relative: where the object is in the subject's frame; None: not known.
    :param subject_size, object_size: the edges of the boxes around them, along the axes of their own frames (m).
    """
    if relative is None:
        return [(UNKNOWN, None)]
    found: list[tuple[str, Any]] = []
    extents = half_extents(relative.orientation, object_size)
    for axis, edge, centre, extent in zip("XYZ", subject_size, relative.position, extents, strict=True):
        own, other = (-edge / 2, edge / 2), (centre - extent, centre + extent)
        name = allen.relation(own, other, LENGTH_TOLERANCE)
        found.append((f":{name}{axis}", allen.distances(name, own, other)))
    angle = angle_between(IDENTITY.orientation, relative.orientation)
    found.append((SAME_ANGLE if angle <= ANGLE_TOLERANCE else OTHER_ANGLE, angle))
    return found
