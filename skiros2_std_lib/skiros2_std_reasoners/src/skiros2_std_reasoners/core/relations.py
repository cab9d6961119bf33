"""Spatial relations between two boxes: one of Allen's per axis, and equal or different orientation.

J. F. Allen, Maintaining knowledge about temporal intervals, Communications of the ACM 26(11), 1983; here between the
edges of boxes, as SkiROS2 computes it. Exact comparisons decide first; ends that are nearly the same then count as
equal (`same`). So two intervals that differ by less than the tolerance are `eq` or, when the first one ends later,
`si`.
"""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_motion.core.geometry import IDENTITY, Pose, angle_between

#: Before, meets, overlaps, starts, during, finishes, equal, and the inverses.
INTERVAL_RELATIONS = ("p", "m", "o", "s", "d", "f", "eq", "pi", "mi", "oi", "si", "di", "fi")

#: Tolerance of lengths: absolute (m), and as a fraction of the longer one.
LENGTH_TOLERANCE = 0.001
_RELATIVE_TOLERANCE = 1e-6

Interval = tuple[float, float]
Metric = float | list[float]

#: Maximum angle between equal orientations (rad).
ANGLE_TOLERANCE = 0.05

#: The relation for an unknown relative pose.
UNKNOWN = ":unknownT"
SAME_ANGLE, OTHER_ANGLE = ":eqA", ":pA"

#: All relations.
ALL = (*(f":{name}{axis}" for axis in "XYZ" for name in INTERVAL_RELATIONS), SAME_ANGLE, OTHER_ANGLE, UNKNOWN)


def relations_between(
    relative: Pose | None, subject_size: Sequence[float], object_size: Sequence[float]
) -> list[tuple[str, Metric]]:
    """Returns the relations from a subject to an object, each with its distance or distances (m, rad).

    :param relative: pose of the object in the subject's frame; None if unknown.
    :param subject_size, object_size: edge lengths of the boxes along the axes of the subject's frame (m).
    """
    if relative is None:
        return [(UNKNOWN, -1.0)]
    found: list[tuple[str, Metric]] = []
    for axis, own, other, centre in zip("XYZ", subject_size, object_size, relative.position, strict=True):
        name, metric = interval_relation((-own / 2, own / 2), (centre - other / 2, centre + other / 2))
        found.append((f":{name}{axis}", metric))
    angle = angle_between(IDENTITY.orientation, relative.orientation)
    found.append((SAME_ANGLE if angle <= ANGLE_TOLERANCE else OTHER_ANGLE, angle))
    return found


def interval_relation(a: Interval, b: Interval) -> tuple[str, Metric]:
    """Returns the relation of `a` to `b`, and the distance or distances between their ends."""
    (a1, a2), (b1, b2) = a, b
    if a2 <= b2:
        if a2 <= b1:
            return ("m", 0.0) if same(a2, b1) else ("p", b1 - a2)
        if a1 > b1:
            return ("f", a1 - b1) if same(a2, b2) else ("d", [a1 - b1, b2 - a2])
        if same(a1, b1):
            return ("eq", 0.0) if same(a2, b2) else ("s", b2 - a2)
        return ("fi", b1 - a1) if same(a2, b2) else ("o", [b1 - a1, a2 - b1, b2 - a2])
    if a1 > b2:
        return "pi", a1 - b2
    if a1 <= b1:
        return ("si", a2 - b2) if same(a1, b1) else ("di", [b1 - a1, a2 - b2])
    return ("mi", 0.0) if same(a1, b2) else ("oi", [a1 - b1, b2 - a1, a2 - b2])


def same(x: float, y: float) -> bool:
    """Whether two lengths are equal within the tolerance."""
    return abs(x - y) <= max(_RELATIVE_TOLERANCE * max(abs(x), abs(y)), LENGTH_TOLERANCE)
