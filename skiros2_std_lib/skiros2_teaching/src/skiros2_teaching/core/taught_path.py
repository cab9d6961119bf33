"""A path of the tool with gripper events: from a recording, smoothed; stored; adapted to another start and goal.

A recording is smoothed by cubic smoothing splines (Reinsch, Smoothing by Spline Functions, 1967), which minimise
`sum |y - f|^2 + l integral |f''|^2`. For samples every `dt` that is a low-pass filter of fourth order,
`1 / (1 + l dt w^4)`, without phase shift: `l` follows from its cut-off frequency, whatever the rate of the samples.
Between samples, a path is a cubic spline; the components of quaternions are interpolated with continuous signs, and
normalised. Pure computation.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, make_smoothing_spline
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, composed, inverted, normalized
from skiros2_motion.core.gripper import GripperEvent

Array = npt.NDArray[np.float64]

#: Cut-off frequency of the smoothing (Hz), between intended motions of a hand and its tremor (8 to 12 Hz).
_CUT_OFF = 2.5
#: Weight of the first and the last sample, and of those at gripper events, where the hand rests; 1 for the others.
_REST_WEIGHT = 100.0
#: Distances from its first or last pose within which the tool rests (m, rad).
_RESTING, _RESTING_TURN = 0.0003, 0.003
#: Periods of stored samples (s), and the deviation from the recording that a period may cause (m, and of quaternions).
_PERIODS, _DEVIATION = (0.4, 0.2, 0.1, 0.05), 1e-4
#: A path is at least this long (m), or turns by at least this angle (rad).
MIN_LENGTH, MIN_TURN = 0.002, 0.02
MAX_SAMPLES = 100_000
#: Maximum distance of a sample from the frame of the path (m), and of the length of a quaternion from 1.
_MAX_DISTANCE, _UNIT = 10.0, 1e-2
#: Maximum width between the fingers (m) and effort (N) of an event.
_MAX_WIDTH, _MAX_EFFORT = 0.5, 1000.0
#: Problems that one error lists in full.
_LISTED = 5


class Sample(NamedTuple):
    """The pose of the tool at a time (s)."""

    time: float
    pose: Pose


@dataclass(frozen=True, eq=False)
class TaughtPath:
    """Samples and gripper events.

    :param times: n, increasing, from 0 (s).
    :param points: n x 7: position (m) and quaternion x, y, z, w.
    :param events: ordered by time.
    :raises WrongValue: there are fewer than two samples, numbers are not finite or out of range, times do not increase,
        or the tool does not move; the text lists all problems.
    """

    times: Array
    points: Array
    events: tuple[GripperEvent, ...] = ()

    def __post_init__(self) -> None:
        problems = _problems(self.times, self.points, self.events)
        if problems:
            raise WrongValue("; ".join(problems))

    @classmethod
    def from_samples(cls, samples: Sequence[Sample], events: Sequence[GripperEvent] = ()) -> TaughtPath:
        """Returns the path of samples as they are. Times may start anywhere; see the class for errors."""
        start = samples[0].time if samples else 0.0
        times = np.array([sample.time - start for sample in samples], dtype=float)
        points = np.array([[*s.pose.position, *s.pose.orientation] for s in samples], dtype=float).reshape(-1, 7)
        moved = sorted(GripperEvent(event.time - start, event.width, event.effort) for event in events)
        return cls(times, points, tuple(moved))

    # -- reading -----------------------------------------------------------------------------------------------

    @property
    def duration(self) -> float:
        """The duration as taught (s)."""
        return float(self.times[-1])

    def pose(self, time: float) -> Pose:
        """Returns the pose of the tool at a time; before the start and after the end, that of the nearest sample."""
        return pose_at(self._spline(min(max(time, 0.0), self.duration)))

    def rates(self, times: Array) -> tuple[Array, Array, Array, Array]:
        """Returns n velocities (m/s), accelerations (m/s2), and angular speeds (rad/s) and accelerations (rad/s2) as
        taught."""
        first, second = self._spline(times, 1), self._spline(times, 2)
        turn, turn_change = (2.0 * np.linalg.norm(rate[:, 3:], axis=1) for rate in (first, second))
        return first[:, :3], second[:, :3], turn, turn_change

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.times, _continuous(self.points), bc_type="natural")

    # -- changing ----------------------------------------------------------------------------------------------

    def smoothed(self) -> TaughtPath:
        """Returns the path without tremor, without standstill at its ends, and with as few samples as keep its shape.

        Gripper events during a standstill at an end move to that end.
        """
        points = _continuous(self.points)
        if len(self.times) >= 5:  # what the library needs
            weights = np.ones(len(self.times))
            rests = [0, len(weights) - 1, *np.searchsorted(self.times, [event.time for event in self.events])]
            weights[np.minimum(rests, len(weights) - 1)] = _REST_WEIGHT
            strength = 1.0 / (float(np.median(np.diff(self.times))) * (2.0 * math.pi * _CUT_OFF) ** 4)
            smooth = [make_smoothing_spline(self.times, column, weights, lam=strength) for column in points.T]
            points = np.column_stack([spline(self.times) for spline in smooth])
            points[:, 3:] /= np.linalg.norm(points[:, 3:], axis=1, keepdims=True)
        begin, end = _moving(points)
        times, points = self.times[begin : end + 1] - self.times[begin], points[begin : end + 1]
        events = tuple(
            GripperEvent(
                min(max(event.time - float(self.times[begin]), 0.0), float(times[-1])), event.width, event.effort
            )
            for event in self.events
        )
        return _thinned(TaughtPath(times, points, events))

    def from_start(self) -> TaughtPath:
        """Returns the path in the frame of its first sample."""
        return self.transformed(inverted(self.pose(0.0)))

    def transformed(self, frame: Pose) -> TaughtPath:
        """Returns the path in another frame.

        :param frame: the pose of its present frame in the other one.
        """
        points = [composed(frame, pose_at(point)) for point in self.points]
        return TaughtPath(self.times, np.array([[*p.position, *p.orientation] for p in points]), self.events)

    def adapted(self, start: Pose | None = None, goal: Pose | None = None) -> TaughtPath:
        """Returns the path from another start to another goal, in the frame of the path; None keeps an end.

        The offsets of both ends are added to the path, weighted linearly with its length: its details stay as taught.
        """
        first, last = (None if pose is None else _difference(self.pose(time), pose)
                       for time, pose in ((0.0, start), (self.duration, goal)))  # fmt: skip
        steps = np.linalg.norm(np.diff(self.points[:, :3], axis=0), axis=1)
        length = np.concatenate(([0.0], np.cumsum(steps)))
        share = (length / length[-1] if length[-1] > MIN_LENGTH else self.times / self.duration)[:, None]
        offset = (1.0 - share) * (np.zeros(6) if first is None else first)
        offset = offset + share * (np.zeros(6) if last is None else last)
        turned = Rotation.from_rotvec(offset[:, 3:]) * Rotation.from_quat(self.points[:, 3:])
        points = np.column_stack((self.points[:, :3] + offset[:, :3], turned.as_quat()))
        return TaughtPath(self.times, points, self.events)

    # -- JSON --------------------------------------------------------------------------------------------------

    def to_json(self) -> tuple[str, str]:
        """Returns samples and events as in `skiros:PathSamples` and `skiros:GripperEvents`, to 1 ms and 10 um."""
        samples = [
            [round(float(t), 3), *(round(float(number), 5) for number in point)]
            for t, point in zip(self.times, self.points, strict=True)
        ]
        events = [[round(event.time, 3), round(event.width, 5), round(event.effort, 3)] for event in self.events]
        return json.dumps(samples, separators=(",", ":")), json.dumps(events, separators=(",", ":"))

    @classmethod
    def from_json(cls, samples: str, events: str = "") -> TaughtPath:
        """Reads the texts of `to_json`.

        :raises WrongValue: a text is not a list of lists of numbers, or the path is invalid.
        """
        rows, commands = _rows("samples", samples, 8), _rows("gripper events", events or "[]", 3)
        points = np.array([row[1:] for row in rows], dtype=float).reshape(-1, 7)
        return cls(np.array([row[0] for row in rows]), points, tuple(GripperEvent(*row) for row in commands))


def pose_at(point: Array) -> Pose:
    """Returns seven numbers as a pose, with a unit quaternion."""
    x, y, z, *turn = (float(number) for number in point)
    return Pose((x, y, z), normalized(turn))


def _thinned(path: TaughtPath) -> TaughtPath:
    """Returns the path with samples at the largest period that keeps its shape, and at its events."""
    for period in _PERIODS:
        count = max(2, round(path.duration / period) + 1)
        if count >= len(path.times):
            break
        times = np.union1d(np.linspace(0.0, path.duration, count), [event.time for event in path.events])
        # an event next to another sample would leave a gap too small for a spline
        times = times[np.concatenate(([True], np.diff(times) > 1e-3))]
        times[-1] = path.duration
        points = np.array([[*pose.position, *pose.orientation] for pose in map(path.pose, times)])
        thin = TaughtPath(times, points, path.events)
        there = np.array([[*pose.position, *pose.orientation] for pose in map(thin.pose, path.times)])
        off = np.minimum(np.abs(there - path.points), np.abs(there + path.points))
        if np.max(np.abs(there[:, :3] - path.points[:, :3])) <= _DEVIATION and np.max(off[:, 3:]) <= 10 * _DEVIATION:
            return thin
    return path


def _moving(points: Array) -> tuple[int, int]:
    """Returns the indices of the last sample near the first one, and of the first sample near the last one.

    :param points: with continuous quaternions.
    """

    def away_from(point: Array) -> npt.NDArray[np.intp]:
        far = np.linalg.norm(points[:, :3] - point[:3], axis=1) > _RESTING
        return np.flatnonzero(far | (2.0 * np.linalg.norm(points[:, 3:] - point[3:], axis=1) > _RESTING_TURN))

    leaves, stays = away_from(points[0]), away_from(points[-1])
    if not len(leaves) or not len(stays) or leaves[0] > stays[-1]:
        return 0, len(points) - 1
    return int(leaves[0]) - 1, int(stays[-1]) + 1


def _continuous(points: Array) -> Array:
    """Returns the points with signs of the quaternions that do not jump."""
    turns = points[:, 3:]
    signs = np.where(np.sum(turns[1:] * turns[:-1], axis=1) < 0.0, -1.0, 1.0)
    return np.column_stack((points[:, :3], turns * np.concatenate(([1.0], np.cumprod(signs)))[:, None]))


def _difference(pose: Pose, other: Pose) -> Array:
    """Returns the translation (m) and rotation vector (rad) from a pose to another one, in their frame."""
    turn = Rotation.from_quat(other.orientation) * Rotation.from_quat(pose.orientation).inv()
    return np.concatenate((np.subtract(other.position, pose.position), turn.as_rotvec()))


def _problems(times: Array, points: Array, events: Sequence[GripperEvent]) -> list[str]:
    if len(times) < 2:
        return [f"a path needs at least 2 samples, got {len(times)}"]
    problems = []
    if len(times) > MAX_SAMPLES:
        problems.append(f"{len(times)} samples: expected up to {MAX_SAMPLES}")
    finite = np.isfinite(times) & np.all(np.isfinite(points), axis=1)
    if not np.all(finite):
        problems.append(f"{_indices(~finite)}: expected finite numbers")
    else:
        if times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
            wrong = np.concatenate(([times[0] != 0.0], np.diff(times) <= 0.0))
            problems.append(f"{_indices(wrong)}: expected times that increase from 0 s")
        far = np.linalg.norm(points[:, :3], axis=1) > _MAX_DISTANCE
        if np.any(far):
            problems.append(f"{_indices(far)}: expected positions up to {_MAX_DISTANCE:g} m from the frame")
        bad = np.abs(np.linalg.norm(points[:, 3:], axis=1) - 1.0) > _UNIT
        if np.any(bad):
            problems.append(f"{_indices(bad)}: expected unit quaternions")
    if not problems:
        length = float(np.max(np.linalg.norm(points[:, :3] - points[0, :3], axis=1)))
        turn = float(np.max((Rotation.from_quat(points[0, 3:]).inv() * Rotation.from_quat(points[:, 3:])).magnitude()))
        if length < MIN_LENGTH and turn < MIN_TURN:
            expected = f"expected at least {MIN_LENGTH * 1000:g} mm or {MIN_TURN:g} rad"
            problems.append(f"the tool moves by {length * 1000:.1f} mm and {turn:.3f} rad: {expected}")
    for number, (time, width, effort) in enumerate(events):
        if not (0.0 <= time <= times[-1] and 0.0 <= width <= _MAX_WIDTH and 0.0 <= effort <= _MAX_EFFORT):
            expected = f"times on the path, 0 to {_MAX_WIDTH:g} m and 0 to {_MAX_EFFORT:g} N"
            problems.append(f"gripper event {number} ({time:g} s, {width:g} m, {effort:g} N): expected {expected}")
    return problems


def _indices(wrong: npt.NDArray[np.bool_]) -> str:
    numbers = np.flatnonzero(wrong)
    more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
    return f"sample{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers[:_LISTED]))}{more}"


def _rows(what: str, text: str, width: int) -> list[list[float]]:
    try:
        rows = json.loads(text)
        if not isinstance(rows, list):
            raise TypeError
        numbers = [[float(number) for number in row] for row in rows]
    except (TypeError, ValueError):
        raise WrongValue(f"{what} {text[:40]!r}: expected a JSON list of lists of {width} numbers") from None
    wrong = [index for index, row in enumerate(numbers) if len(row) != width]
    if wrong:
        raise WrongValue(f"{what}: expected {width} numbers in each list, got {len(numbers[wrong[0]])} in {wrong[0]}")
    return numbers
