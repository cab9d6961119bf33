"""Makes a trajectory of a path with corners, within limits of joint velocities and accelerations.

The corners are rounded by parabolas, so that the arm does not stop at them. The speed along the path is as high as the
limits allow (Kunz and Stilman, Time-Optimal Trajectory Generation for Path Following with Bounded Acceleration and
Velocity, 2012). With the position q along the path s:

    q. = q' s.      q.. = q'' s.^2 + q' s..
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.motion import Pieces
from skiros2_motion.core.time_scaling import fastest_speeds

Array = npt.NDArray[np.float64]

#: Maximum distance of a rounding's ends from its corner, and minimum before the arm stops at the corner (rad).
_ROUNDING, _LEAST_ROUNDING = 0.4, 0.02
#: Distance between points at which the speed is computed (rad), and between checks of a rounding.
_GRID, _CHECKED = 0.02, 0.02
#: Time between points of the trajectory (s).
PERIOD = 0.04
#: Maximum number of points of a trajectory.
_MOST_POINTS = 1500
#: Fraction of the acceleration limits that is used; drivers interpolate between the points.
_MARGIN = 0.95
#: Fraction of the acceleration in a rounding for the change of direction.
_TURNING = 0.7


class TimedPoint(NamedTuple):
    """Joint positions (rad or m) and velocities (per second) at a time (s) after the start."""

    time: float
    positions: Array
    velocities: Array


class _Piece(NamedTuple):
    """A part of the path: q(s) = start + slope s + bend s^2 / 2 for s from 0 to length."""

    start: Array
    slope: Array
    bend: Array
    length: float

    def at(self, s: float) -> Array:
        return self.start + self.slope * s + self.bend * (s * s / 2)

    def slope_at(self, s: float) -> Array:
        return self.slope + self.bend * s


def timed_path(
    corners: Sequence[Array], velocities: Array, accelerations: Array, is_free: Callable[[Array], bool]
) -> Pieces[list[TimedPoint]]:
    """Returns points of a trajectory through a path, at rest at both ends; in pieces of one collision check.

    :param corners: a path whose straight lines are free of collisions (rad or m).
    :param velocities: limits, per second and above 0.
    :param accelerations: limits, per second squared and above 0.
    :param is_free: checks roundings; one that is in collision becomes tighter, and at last the arm stops at the corner.
    """
    kept = [corners[0]]
    kept += [q for q in corners[1:] if np.linalg.norm(q - kept[-1]) > 1e-6]
    if len(kept) == 1:
        return [TimedPoint(0.0, kept[0], np.zeros(len(kept[0])))]
    sections = yield from _sections(kept, is_free)
    result = [TimedPoint(0.0, kept[0], np.zeros(len(kept[0])))]
    for pieces in sections:
        yield
        begin = result[-1].time
        result += [
            TimedPoint(begin + time, q, dq) for time, q, dq in _timed(pieces, velocities, accelerations * _MARGIN)
        ]
    return result


def _sections(corners: Sequence[Array], is_free: Callable[[Array], bool]) -> Pieces[list[list[_Piece]]]:
    """Returns the pieces of the path in sections; the arm stops between two sections."""
    sections: list[list[_Piece]] = [[]]
    position = corners[0]  # end of the last piece
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        size = min(_ROUNDING, *(float(np.linalg.norm(q - corner)) / 2 for q in (before, after)))
        into, out = _direction(before, corner), _direction(corner, after)
        while size >= _LEAST_ROUNDING:
            rounding = _Piece(corner - size * into, into, (out - into) / (2 * size), 2 * size)
            if (yield from _is_free(rounding, is_free)):
                _add_line(sections[-1], position, rounding.start)
                sections[-1].append(rounding)
                position = corner + size * out
                break
            size /= 2
        else:
            _add_line(sections[-1], position, corner)
            sections.append([])
            position = corner
    _add_line(sections[-1], position, corners[-1])
    return [section for section in sections if section]


def _is_free(piece: _Piece, is_free: Callable[[Array], bool]) -> Pieces[bool]:
    for s in np.linspace(0.0, piece.length, int(piece.length / _CHECKED) + 3)[1:-1]:
        yield
        if not is_free(piece.at(float(s))):
            return False
    return True


def _direction(start: Array, end: Array) -> Array:
    direction: Array = (end - start) / np.linalg.norm(end - start)
    return direction


def _add_line(pieces: list[_Piece], start: Array, end: Array) -> None:
    length = float(np.linalg.norm(end - start))
    if length > 1e-9:
        pieces.append(_Piece(start, (end - start) / length, np.zeros(len(start)), length))


def _timed(pieces: Sequence[_Piece], velocities: Array, accelerations: Array) -> list[TimedPoint]:
    """Returns the points of a section after its first one."""
    cells: list[tuple[_Piece, float, float]] = []  # each with constant acceleration along the path
    for piece in pieces:
        ends = np.linspace(0.0, piece.length, max(4, int(piece.length / _GRID)) + 1)
        cells += [(piece, float(a), float(b)) for a, b in itertools.pairwise(ends)]
    # maximum of s. at the ends of the cells
    most = np.full(len(cells) + 1, np.inf)
    push = np.empty(len(cells))  # maximum of |s..| in each cell
    tiny = 1e-12
    for i, (piece, a, b) in enumerate(cells):
        slope = np.maximum(np.abs(piece.slope_at(a)), np.abs(piece.slope_at(b))) + tiny
        bend = np.abs(piece.bend) + tiny
        cell_most = min(np.min(velocities / slope), np.sqrt(_TURNING * np.min(accelerations / bend)))
        push[i] = np.min((accelerations - bend * cell_most**2) / slope)
        most[i], most[i + 1] = min(most[i], cell_most), min(most[i + 1], cell_most)
    most[0] = most[-1] = 0.0
    lengths = np.array([b - a for _, a, b in cells])
    speeds = fastest_speeds(most, push, push, lengths)
    durations = 2 * lengths / (speeds[:-1] + speeds[1:])
    times = np.concatenate([[0.0], np.cumsum(durations)])
    count = min(max(2, int(np.ceil(times[-1] / PERIOD))), _MOST_POINTS)
    points = []
    for time in np.linspace(0.0, times[-1], count + 1)[1:]:
        i = min(int(np.searchsorted(times, time, side="right")) - 1, len(cells) - 1)
        piece, a, b = cells[i]
        since = time - times[i]
        change = (speeds[i + 1] - speeds[i]) / durations[i]
        s = min(a + speeds[i] * since + change * since**2 / 2, b)
        speed = speeds[i] + change * since
        points.append(TimedPoint(float(time), piece.at(s), piece.slope_at(s) * speed))
    return points
