"""The path of joints through the points of a trajectory: checked against the joint limits, then evaluated by time.

Segments are quintic polynomials if both points have accelerations, otherwise cubic. Points without velocities get the
mean of the slopes on both sides, and 0 at extrema and at the ends, so that no joint overshoots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PPoly

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_sim.core.joint import Joint

Array = npt.NDArray[np.float64]

#: Tolerance of limits for rounding errors (rad, m, or per second).
_ROUNDING = 1e-3
#: Fractions of a segment at which positions and velocities are checked.
_SAMPLES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True)
class JointPoint:
    """Target of the joints at `time` seconds after the start of the trajectory. All but positions may be empty."""

    time: float
    positions: tuple[float, ...]
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()
    efforts: tuple[float, ...] = ()


@dataclass(frozen=True)
class JointTolerance:
    """Tolerance of a joint, as in control_msgs: 0 is the driver's default, negative is unlimited."""

    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0


@dataclass(frozen=True)
class JointGoal:
    """A goal of control_msgs/FollowJointTrajectory. `start`: simulated time (s) of its start; None for now."""

    joints: tuple[str, ...]
    points: tuple[JointPoint, ...]
    start: float | None = None
    path_tolerance: Mapping[str, JointTolerance] = field(default_factory=dict)
    goal_tolerance: Mapping[str, JointTolerance] = field(default_factory=dict)
    goal_time_tolerance: float = 0.0


def order_of(goal: JointGoal, limits: Sequence[Joint]) -> list[int]:
    """Returns the index in the goal of each joint of the arm.

    :raises UnknownName: the goal does not name each joint exactly once.
    """
    own = [joint.name for joint in limits]
    unknown = sorted(set(goal.joints).difference(own))
    if unknown:
        raise UnknownName(f"no joint {', '.join(map(repr, unknown))} in this arm; it has {', '.join(own)}")
    doubled = sorted({name for name in goal.joints if goal.joints.count(name) > 1})
    if doubled:
        raise UnknownName(f"joint {', '.join(doubled)} is named more than once")
    missing = [name for name in own if name not in goal.joints]
    if missing:
        raise UnknownName(f"joint {', '.join(missing)} is missing; all of this arm's are expected: {', '.join(own)}")
    for kind, tolerances in (("path", goal.path_tolerance), ("goal", goal.goal_tolerance)):
        strange = sorted(set(tolerances).difference(own))
        if strange:
            raise UnknownName(f"{kind} tolerance for {', '.join(map(repr, strange))}, which this arm does not have")
    return [goal.joints.index(name) for name in own]


class JointPath:
    """A checked trajectory. Errors name joint, point and value.

    :param positions: current positions of the arm; with `velocities`, the start of the first segment.
    :raises UnknownName: the joints are not those of the arm.
    :raises WrongValue: any other error.
    """

    def __init__(self, goal: JointGoal, limits: Sequence[Joint], positions: Array, velocities: Array) -> None:
        order = order_of(goal, limits)
        self._limits = limits
        self._lower = np.array([joint.lower for joint in limits])
        self._upper = np.array([joint.upper for joint in limits])
        # 0 in a model means no limit
        self._fastest = np.array([joint.velocity or np.inf for joint in limits])
        self._strongest = np.array([joint.effort or np.inf for joint in limits])
        times = _times(goal)
        rows = [self._row(goal.points[i], i, order) for i in range(len(times))]
        if times[0] > 0.0:
            times.insert(0, 0.0)
            rows.insert(0, (positions, velocities, None))
            self._first = 0
        else:
            self._first = 1  # index in the goal of the end of the first segment
        self._times = np.array(times)
        self._q = np.array([row[0] for row in rows])
        self._qd = self._velocities([row[1] for row in rows])
        if len(rows) > 1:  # else it begins and ends at once
            self._path = self._spline([row[2] for row in rows])
            self._speed = self._path.derivative()
            self._check_between()

    @property
    def duration(self) -> float:
        """Time from the start to the last point (s)."""
        return float(self._times[-1])

    @property
    def start(self) -> Array:
        """Positions at the start."""
        start: Array = self._q[0]
        return start

    @property
    def end(self) -> Array:
        """Positions of the last point."""
        end: Array = self._q[-1]
        return end

    def at(self, time: float) -> tuple[Array, Array]:
        """Positions and velocities at `time` seconds after the start; at rest before and after."""
        if time <= 0.0 or time >= self.duration:
            return self._q[0 if time <= 0.0 else -1], np.zeros(len(self._limits))
        return self._path(time), self._speed(time)

    def _row(self, point: JointPoint, i: int, order: Sequence[int]) -> tuple[Array, Array | None, Array | None]:
        """Returns positions, velocities and accelerations of a point in the arm's order; checks limits."""
        values: list[Array | None] = []
        for kind in ("positions", "velocities", "accelerations", "efforts"):
            given: tuple[float, ...] = getattr(point, kind)
            if not given and kind != "positions":
                values.append(None)
                continue
            if len(given) != len(order):
                raise WrongValue(f"point {i} has {len(given)} {kind} for {len(order)} joints")
            row = np.array([given[k] for k in order], dtype=float)
            for k in _where(~np.isfinite(row)):
                raise WrongValue(f"point {i}: {kind} of {self._limits[k].name} is {row[k]}, which is not finite")
            values.append(row)
        positions, velocities, accelerations, efforts = values
        assert positions is not None
        for k in _where((positions < self._lower - _ROUNDING) | (positions > self._upper + _ROUNDING)):
            raise WrongValue(
                f"point {i}: {self._limits[k].name} at {positions[k]:.4f} is beyond its limits "
                f"{self._lower[k]:.4f} to {self._upper[k]:.4f}"
            )
        if velocities is not None:
            for k in _where(np.abs(velocities) > self._fastest + _ROUNDING):
                raise WrongValue(
                    f"point {i}: {self._limits[k].name} at {velocities[k]:.4f} per second is faster than its limit "
                    f"{self._fastest[k]:.4f}"
                )
        if efforts is not None:
            for k in _where(np.abs(efforts) > self._strongest + _ROUNDING):
                raise WrongValue(
                    f"point {i}: effort {efforts[k]:.4f} of {self._limits[k].name} is above its limit "
                    f"{self._strongest[k]:.4f}"
                )
        return positions, velocities, accelerations

    def _velocities(self, given: Sequence[Array | None]) -> Array:
        """Returns the velocities at all points; missing ones are derived from the slopes."""
        result = np.zeros_like(self._q)
        slopes = np.diff(self._q, axis=0) / np.diff(self._times)[:, None]
        before, after = slopes[:-1], slopes[1:]
        # the mean, but at most three times the smaller slope: the cubic stays between its ends
        # (Fritsch and Carlson, Monotone Piecewise Cubic Interpolation, 1980)
        least = 3 * np.minimum(np.abs(before), np.abs(after))
        result[1:-1] = np.where(before * after > 0, np.clip((before + after) / 2, -least, least), 0.0)
        for i, velocities in enumerate(given):
            if velocities is not None:
                result[i] = velocities
        return result

    def _spline(self, accelerations: Sequence[Array | None]) -> PPoly:
        """Returns the positions as a function of time. Segments between two given accelerations are quintic."""
        t = np.diff(self._times)[:, None]
        start, v0, v1 = self._q[:-1], self._qd[:-1], self._qd[1:]
        d = np.diff(self._q, axis=0) / t
        none = np.zeros_like(d)
        cubic = (none, none, (v0 + v1 - 2 * d) / t**2, (3 * d - 2 * v0 - v1) / t)
        given = np.array([row is not None for row in accelerations])
        a = np.array([np.zeros(len(self._limits)) if row is None else row for row in accelerations])
        a0, a1 = a[:-1], a[1:]
        quintic = (
            (12 * d - 6 * v1 - 6 * v0 - (a0 - a1) * t) / (2 * t**4),
            (-30 * d + 14 * v1 + 16 * v0 + (3 * a0 - 2 * a1) * t) / (2 * t**3),
            (20 * d - 8 * v1 - 12 * v0 - (3 * a0 - a1) * t) / (2 * t**2),
            a0 / 2,
        )
        are_quintic = (given[:-1] & given[1:])[:, None]
        return PPoly(np.array([*np.where(are_quintic, quintic, cubic), v0, start]), self._times)

    def _check_between(self) -> None:
        """Checks the limits within all segments.

        :raises WrongValue: a joint exceeds a limit.
        """
        # a joint that starts beyond a limit may return from there
        lower, upper = np.minimum(self._lower, self._q[0]), np.maximum(self._upper, self._q[0])
        durations = np.diff(self._times)
        samples = self._times[:-1, None] + _SAMPLES * durations[:, None]
        q, qd = self._path(samples), self._speed(samples)  # segment, sample, joint
        speeds, lows, highs = np.abs(qd).max(axis=1), q.min(axis=1), q.max(axis=1)
        too_fast = ~(speeds <= self._fastest + _ROUNDING)
        beyond = (lows < lower - _ROUNDING) | (highs > upper + _ROUNDING)
        for i in _where((too_fast | beyond).any(axis=1)):
            t, fastest, lowest, highest = durations[i], speeds[i], lows[i], highs[i]
            end = i + self._first  # index in the goal
            where = f"between points {end - 1} and {end}" if end else "to point 0"
            for k in _where(too_fast[i]):
                raise WrongValue(
                    f"{where}: {self._limits[k].name} would move at {fastest[k]:.4f} per second, its limit is "
                    f"{self._fastest[k]:.4f}; {t:.3f} s are too short for {abs(self._q[i + 1, k] - self._q[i, k]):.4f}"
                )
            for k in _where(beyond[i]):
                raise WrongValue(
                    f"{where}: {self._limits[k].name} would go from {lowest[k]:.4f} to {highest[k]:.4f}, its limits "
                    f"are {self._lower[k]:.4f} to {self._upper[k]:.4f}"
                )


def _where(wrong: npt.NDArray[np.bool_]) -> list[int]:
    """Returns the indices of true values."""
    return [int(k) for k in np.flatnonzero(wrong)]


def _times(goal: JointGoal) -> list[float]:
    """Returns the times of the goal's points.

    :raises WrongValue: there are none, or they are not finite and increasing.
    """
    if not goal.points:
        raise WrongValue("the trajectory has no points")
    times = [point.time for point in goal.points]
    for i, time in enumerate(times):
        if not np.isfinite(time) or time < 0.0:
            raise WrongValue(f"point {i}: time {time} is not a finite number of seconds, 0 or more")
        if i and time <= times[i - 1]:
            raise WrongValue(f"point {i}: time {time} is not later than the {times[i - 1]} of point {i - 1}")
    return times
