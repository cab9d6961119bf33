"""Spatial relations between two boxes: one of Allen's per axis, and equal or different orientation."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_std_reasoners.core import allen
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, angle_between

#: Maximum angle between equal orientations (rad).
ANGLE_TOLERANCE = 0.05

#: The relation for an unknown relative pose.
UNKNOWN = ":unknownT"
SAME_ANGLE, OTHER_ANGLE = ":eqA", ":pA"

#: All relations.
ALL = (*(f":{name}{axis}" for axis in "XYZ" for name in allen.RELATIONS), SAME_ANGLE, OTHER_ANGLE, UNKNOWN)


def relations_between(
    relative: Pose | None, subject_size: Sequence[float], object_size: Sequence[float]
) -> list[tuple[str, allen.Metric]]:
    """Returns the relations from a subject to an object, each with its distance or distances (m, rad).

    :param relative: pose of the object in the subject's frame; None if unknown.
    :param subject_size, object_size: edge lengths of the boxes along the axes of the subject's frame (m).
    """
    if relative is None:
        return [(UNKNOWN, -1.0)]
    found: list[tuple[str, allen.Metric]] = []
    for axis, own, other, centre in zip("XYZ", subject_size, object_size, relative.position, strict=True):
        name, metric = allen.relation((-own / 2, own / 2), (centre - other / 2, centre + other / 2))
        found.append((f":{name}{axis}", metric))
    angle = angle_between(IDENTITY.orientation, relative.orientation)
    found.append((SAME_ANGLE if angle <= ANGLE_TOLERANCE else OTHER_ANGLE, angle))
    return found
