"""Allen's interval algebra: how two intervals lie to each other.

J. F. Allen, Maintaining knowledge about temporal intervals, Communications of the ACM 26(11), 1983. Here the intervals
are the edges of boxes, and ends that are closer than a tolerance count as equal.
"""

from __future__ import annotations

#: Before, meets, overlaps, starts, during, finishes, equal, and the inverses.
RELATIONS = ("p", "m", "o", "s", "d", "f", "eq", "pi", "mi", "oi", "si", "di", "fi")

Interval = tuple[float, float]


def relation(a: Interval, b: Interval, tolerance: float) -> str:
    """The one of `RELATIONS` in which `a` stands to `b`.

    An interval without length is a point: at an end of the other one it starts or finishes it.
    """
    starts = _compare(a[0], b[0], tolerance)
    ends = _compare(a[1], b[1], tolerance)
    if starts == 0 and ends == 0:
        return "eq"
    if starts == 0:
        return "s" if ends < 0 else "si"
    if ends == 0:
        return "f" if starts > 0 else "fi"
    after = _compare(a[1], b[0], tolerance)
    if after <= 0:
        return "p" if after < 0 else "m"
    before = _compare(a[0], b[1], tolerance)
    if before >= 0:
        return "pi" if before > 0 else "mi"
    if starts < 0:
        return "o" if ends < 0 else "di"
    return "d" if ends < 0 else "oi"


def distances(name: str, a: Interval, b: Interval) -> float | tuple[float, float]:
    """How far the intervals are from each other.

    For intervals that are apart or meet, the gap; for others, from start to start and from end to end.
    """
    if name in ("p", "m"):
        return b[0] - a[1]
    if name in ("pi", "mi"):
        return a[0] - b[1]
    return b[0] - a[0], b[1] - a[1]


def _compare(a: float, b: float, tolerance: float) -> int:
    return 0 if abs(a - b) <= tolerance else (1 if a > b else -1)
