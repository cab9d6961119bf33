"""The path of joints through the points of a trajectory: checked against the joint limits, then evaluated by time.

Segments are quintic polynomials if both points have accelerations, otherwise cubic. Points without velocities get the
mean of the slopes on both sides, and 0 at extrema and at the ends, so that no joint overshoots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

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
        self._qdd = [row[2] for row in rows]
        self._polynomials = np.array([self._polynomial(i) for i in range(len(times) - 1)])
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
        i = int(np.searchsorted(self._times, time, side="right")) - 1
        return _evaluated(self._polynomials[i], time - float(self._times[i]))

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
                raise WrongValue(f"point {i}: {kind} of {self._limits[k].name} is {row[k]}, which is no number")
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
        slopes = np.diff(self._q, axis=0) / np.diff(self._times)[:, None]
        result = np.zeros_like(self._q)
        for i, velocities in enumerate(given):
            if velocities is not None:
                result[i] = velocities
            elif 0 < i < len(given) - 1:
                before, after = slopes[i - 1], slopes[i]
                # the mean, but at most three times the smaller slope: the cubic stays between its ends
                # (Fritsch and Carlson, Monotone Piecewise Cubic Interpolation, 1980)
                least = 3 * np.minimum(np.abs(before), np.abs(after))
                result[i] = np.where(before * after > 0, np.clip((before + after) / 2, -least, least), 0.0)
        return result

    def _polynomial(self, i: int) -> Array:
        """Returns the six coefficients (rows, constant first) of each joint for segment i."""
        t = float(self._times[i + 1] - self._times[i])
        q0, q1, v0, v1 = self._q[i], self._q[i + 1], self._qd[i], self._qd[i + 1]
        a0, a1 = self._qdd[i], self._qdd[i + 1]
        none = np.zeros_like(q0)
        if a0 is None or a1 is None:
            return np.array(
                [
                    q0,
                    v0,
                    (3 * (q1 - q0) / t - 2 * v0 - v1) / t,
                    (v0 + v1 - 2 * (q1 - q0) / t) / t**2,
                    none,
                    none,
                ]
            )
        d = (q1 - q0) / t
        return np.array(
            [
                q0,
                v0,
                a0 / 2,
                (20 * d - 8 * v1 - 12 * v0 - (3 * a0 - a1) * t) / (2 * t**2),
                (-30 * d + 14 * v1 + 16 * v0 + (3 * a0 - 2 * a1) * t) / (2 * t**3),
                (12 * d - 6 * v1 - 6 * v0 - (a0 - a1) * t) / (2 * t**4),
            ]
        )

    def _check_between(self) -> None:
        """Checks the limits within all segments.

        :raises WrongValue: a joint exceeds a limit.
        """
        # a joint that starts beyond a limit may return from there
        lower, upper = np.minimum(self._lower, self._q[0]), np.maximum(self._upper, self._q[0])
        for i, polynomial in enumerate(self._polynomials):
            t = float(self._times[i + 1] - self._times[i])
            q, qd = _evaluated(polynomial[:, None, :], (_SAMPLES * t)[:, None])
            fastest, lowest, highest = np.max(np.abs(qd), axis=0), np.min(q, axis=0), np.max(q, axis=0)
            end = i + self._first  # index in the goal
            where = f"between points {end - 1} and {end}" if end else "to point 0"
            for k in _where(~(fastest <= self._fastest + _ROUNDING)):
                raise WrongValue(
                    f"{where}: {self._limits[k].name} would move at {fastest[k]:.4f} per second, its limit is "
                    f"{self._fastest[k]:.4f}; {t:.3f} s are too short for {abs(self._q[i + 1, k] - self._q[i, k]):.4f}"
                )
            for k in _where((lowest < lower - _ROUNDING) | (highest > upper + _ROUNDING)):
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
            raise WrongValue(f"point {i}: time {time} is not a number of seconds from the start on")
        if i and time <= times[i - 1]:
            raise WrongValue(f"point {i}: time {time} does not come after the {times[i - 1]} of point {i - 1}")
    return times


def _evaluated(c: Array, t: Array | float) -> tuple[Array, Array]:
    """Evaluates polynomials of degree 5, constant first, and their derivatives."""
    q = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))))
    qd = c[1] + t * (2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5])))
    return q, qd
