"""Allen's interval algebra, as SkiROS2 computes it between the edges of boxes.

J. F. Allen, Maintaining knowledge about temporal intervals, Communications of the ACM 26(11), 1983. Exact comparisons
decide first; ends that are nearly the same then count as equal (`same`). So two intervals that differ by less than the
tolerance are `eq` or, when the first one ends later, `si`.
"""

from __future__ import annotations

#: Before, meets, overlaps, starts, during, finishes, equal, and the inverses.
RELATIONS = ("p", "m", "o", "s", "d", "f", "eq", "pi", "mi", "oi", "si", "di", "fi")

#: Tolerance of lengths: absolute (m), and as a fraction of the longer one.
LENGTH_TOLERANCE = 0.001
_RELATIVE_TOLERANCE = 1e-6

Interval = tuple[float, float]
Metric = float | list[float]


def relation(a: Interval, b: Interval) -> tuple[str, Metric]:
    """Returns the relation of `a` to `b`, one of `RELATIONS`, with the distance or distances between their ends."""
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
