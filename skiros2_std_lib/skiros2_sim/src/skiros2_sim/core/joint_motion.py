"""Moves the joints of an arm along a trajectory, as a driver of control_msgs/FollowJointTrajectory does.

The path through the points is checked against the joint limits, then evaluated by time. Segments are quintic
polynomials if both points have accelerations, otherwise cubic. Points without velocities get the mean of the slopes
on both sides, and 0 at extrema and at the ends, so that no joint overshoots.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PPoly

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_motion.core.motion import Outcome, State
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.part_contacts import PartContacts
from skiros2_sim.core.physics import Joint

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


@dataclass(frozen=True)
class JointTolerance:
    """Tolerance of a joint, as in control_msgs: 0 is the driver's default, negative is unlimited."""

    position: float = 0.0
    velocity: float = 0.0


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
        times = _times(goal)
        rows = [self._row(goal.points[i], i, order) for i in range(len(times))]
        if times[0] > 0.0:
            times.insert(0, 0.0)
            rows.insert(0, (positions, velocities, None))
            self._first = 0
        else:
            self._first = 1  # index in the goal of the end of the first segment
        self._times = np.array(times)
        #: Time from the start to the last point (s).
        self.duration = times[-1]
        self._q = np.array([row[0] for row in rows])
        self._qd = self._velocities([row[1] for row in rows])
        if len(rows) > 1:  # else it begins and ends at once
            self._path = self._spline([row[2] for row in rows])
            self._speed = self._path.derivative()
            self._check_between()

    def at(self, time: float) -> tuple[Array, Array]:
        """Positions and velocities at `time` seconds after the start; at rest before and after."""
        if time <= 0.0 or time >= self.duration:
            return self._q[0 if time <= 0.0 else -1], np.zeros(len(self._limits))
        return self._path(time), self._speed(time)

    def _row(self, point: JointPoint, i: int, order: Sequence[int]) -> tuple[Array, Array | None, Array | None]:
        """Returns positions, velocities and accelerations of a point in the arm's order; checks limits."""
        values: list[Array | None] = []
        for kind in ("positions", "velocities", "accelerations"):
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
        positions, velocities, accelerations = values
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


#: Error codes of the action's result.
SUCCESSFUL = 0
INVALID_GOAL = -1
INVALID_JOINTS = -2
OLD_HEADER_TIMESTAMP = -3
PATH_TOLERANCE_VIOLATED = -4
GOAL_TOLERANCE_VIOLATED = -5

#: Default tolerances: path and goal (rad or m), velocity at the goal (per second), delay of the arrival (s).
_PATH, _GOAL, _AT_REST, _GOAL_TIME = 0.1, 0.01, 0.05, 2.0
#: Braking time of a cancelled motion (s).
_BRAKING = 0.25
#: After a collision the arm retreats until the contact force is below this (N), for at most this time (s).
_PRESSED, _MAX_RETREAT = 5.0, 1.0


class JointState(NamedTuple):
    """Positions (rad or m) and velocities of all joints, in the order of the arm."""

    positions: Array
    velocities: Array


class JointMotion:
    """A motion along a trajectory. A trajectory with a later start waits; of one that started in the past, the
    remaining points are executed."""

    def __init__(self, controller: ArmController, goal: JointGoal) -> None:
        self.outcome: Outcome | None = None
        self._controller = controller
        self._arm = controller.arm
        self._goal = _with_full_names(goal, self._arm.name)
        self._speed = 1.0  # rate of time along the path; less while braking
        self._brakes = False
        self._final_outcome: Outcome | None = None  # outcome after the retreat
        self._retreat_time = 0.0  # s
        self._contacts = PartContacts(controller.world, controller.arm_prefix)
        self._actual = self._state()
        #: Time on the path (s); negative before the start.
        self._time = 0.0 if goal.start is None else min(0.0, controller.world.time - goal.start)
        self._path: JointPath | None = None
        try:
            self._path = self._checked()
        except (Refused, UnknownName, WrongValue) as error:
            code = INVALID_JOINTS if isinstance(error, UnknownName) else INVALID_GOAL
            self._end(State.REJECTED, code, str(error))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the order of the feedback, without the prefix of the arm."""
        return tuple(joint.name.removeprefix(self._arm.name + "/") for joint in self._arm.joints)

    def feedback(self) -> tuple[JointState, JointState, JointState]:
        """Returns desired state, actual state and error of the last step."""
        desired, actual = self._desired(), self._actual
        return desired, actual, JointState(*(w - a for w, a in zip(desired, actual, strict=True)))

    def update(self, dt: float) -> None:
        """Advances by `dt` seconds."""
        if self.outcome is not None or self._path is None:
            return
        self._actual = self._state()
        if self._controller.compliant:
            self._end(State.ABORTED, INVALID_GOAL, f"controller {self._controller.active!r} was activated meanwhile")
        elif self._final_outcome is not None:
            self._retreat(dt)
        elif self._time >= 0.0 and (reason := self._off_the_path()):
            self._controller.hold()
            self._final_outcome = Outcome(State.ABORTED, reason + self._contacts.describe(), PATH_TOLERANCE_VIOLATED)
        elif self._brakes:
            self._brake(dt)
        elif self._time >= self._path.duration:
            self._arrive(dt)
        else:
            if self._time <= 0.0:
                self._contacts.restart()
            self._go_on(dt)

    def cancel(self) -> None:
        """Brakes along the path."""
        self._brakes = True

    def _go_on(self, dt: float) -> None:
        self._time += self._speed * dt
        if self._time >= 0.0:
            self._controller.follow(*self._desired())

    def _brake(self, dt: float) -> None:
        self._speed -= dt / _BRAKING
        if self._speed > 0.0 and self._time >= 0.0:
            self._go_on(dt)
            return
        self._speed = 0.0
        if self._time >= 0.0:
            self._controller.follow(*self._desired())
        self._end(State.PREEMPTED, SUCCESSFUL, "cancelled")

    def _arrive(self, dt: float) -> None:
        """Ends when all joints are within the goal tolerances, or the time for that has passed."""
        assert self._path is not None
        self._time += dt
        self._controller.follow(*self._desired())
        late = self._time - self._path.duration
        off = self._off_the_goal()
        if not off:
            self._end(State.SUCCEEDED, SUCCESSFUL, "")
        elif late > (self._goal.goal_time_tolerance or _GOAL_TIME):
            off += self._contacts.describe()
            self._end(State.ABORTED, GOAL_TOLERANCE_VIOLATED, f"{late:.2f} s after the trajectory's end: {off}")

    def _retreat(self, dt: float) -> None:
        """Moves back along the path until the contact force is low, then holds."""
        if self._retreat_time < _MAX_RETREAT and self._time > 0.0 and sum(self._contacts.new().values()) > _PRESSED:
            self._retreat_time += dt
            self._time = max(0.0, self._time - dt)
            self._controller.follow(self._desired().positions, np.zeros(len(self._arm.joints)))
        else:
            self.outcome = self._final_outcome

    def _off_the_path(self) -> str:
        """Returns a description of an exceeded limit of the wrench or path tolerance; "" without one."""
        if self._controller.stop is not None:
            return f"stopped at a {self._controller.stop}"
        return self._violation(self._goal.path_tolerance, self._desired(), (_PATH, math.inf), "path")

    def _off_the_goal(self) -> str:
        """Returns a description of a violated goal tolerance; "" without one."""
        at_rest = JointState(self._desired().positions, np.zeros(len(self._arm.joints)))
        return self._violation(self._goal.goal_tolerance, at_rest, (_GOAL, _AT_REST), "goal")

    def _violation(
        self, tolerances: Mapping[str, JointTolerance], desired: JointState, defaults: tuple[float, float], what: str
    ) -> str:
        """Compares the actual state with the desired one.

        :param defaults: tolerances of position and velocity for 0.
        """
        off, faster = (np.abs(wanted - actual) for wanted, actual in zip(desired, self._actual, strict=True))
        for i, joint in enumerate(self._arm.joints):
            tolerance = tolerances.get(joint.name, JointTolerance())
            most, fastest = _limit(tolerance.position, defaults[0]), _limit(tolerance.velocity, defaults[1])
            if off[i] > most:
                return f"{joint.name} is {off[i]:.4f} off the {what}, {most:g} is allowed"
            if faster[i] > fastest:
                return f"{joint.name} is {faster[i]:.4f} per second off the speed of the {what}, {fastest:g} is allowed"
        return ""

    def _desired(self) -> JointState:
        if self._path is None:
            return self._actual
        positions, velocities = self._path.at(self._time)
        return JointState(positions, velocities * self._speed)

    def _state(self) -> JointState:
        return JointState(np.array(self._arm.positions()), np.array(self._arm.velocities()))

    def _checked(self) -> JointPath | None:
        """Returns the path of the goal; None if its time is over.

        :raises WrongValue: a number is invalid.
        :raises UnknownName: a joint does not exist.
        :raises Refused: the arm has stopped at a limit.
        """
        controller, goal = self._controller, self._goal
        if controller.compliant:
            raise WrongValue(
                f"controller {controller.active!r} of arm {self._arm.name} is active; a trajectory needs "
                f"{controller.names[0]!r}: switch to it first"
            )
        controller.check_not_stopped()
        for name, tolerance in [*goal.path_tolerance.items(), *goal.goal_tolerance.items()]:
            if not all(map(math.isfinite, (tolerance.position, tolerance.velocity))):
                raise WrongValue(f"the tolerance of {name} is {tolerance}, which is not finite")
        if not 0.0 <= goal.goal_time_tolerance < math.inf:
            raise WrongValue(f"goal time tolerance {goal.goal_time_tolerance}: expected seconds, 0 or more")
        if goal.start is not None and not math.isfinite(goal.start):
            raise WrongValue(f"start {goal.start} is not a finite time")
        # the whole trajectory is checked, including points in the past
        path = JointPath(goal, self._arm.joints, *self._actual)
        over = controller.world.time - goal.start if goal.start is not None else 0.0
        if over > 0.0:
            left = tuple(replace(p, time=p.time - over) for p in goal.points if p.time > over)
            if not left:
                text = f"the trajectory began {over:.3f} s ago and ended {over - path.duration:.3f} s ago"
                self._end(State.REJECTED, OLD_HEADER_TIMESTAMP, text)
                return None
            path = JointPath(replace(goal, points=left), self._arm.joints, *self._actual)
        for joint, start, actual in zip(self._arm.joints, path.at(0.0)[0], self._actual.positions, strict=True):
            if abs(start - actual) > _PATH:
                raise WrongValue(
                    f"the trajectory begins immediately with {joint.name} at {start:.4f}, but it is at {actual:.4f}"
                )
        return path

    def _end(self, state: State, code: int, text: str) -> None:
        self.outcome = Outcome(state, text, code)


def _with_full_names(goal: JointGoal, arm: str) -> JointGoal:
    """Adds the prefix `ARM/` to the joint names of a goal, as in the model; drivers of one arm omit it."""

    def full(name: str) -> str:
        return name if name.startswith(arm + "/") else f"{arm}/{name}"

    return replace(
        goal,
        joints=tuple(full(name) for name in goal.joints),
        path_tolerance={full(name): tolerance for name, tolerance in goal.path_tolerance.items()},
        goal_tolerance={full(name): tolerance for name, tolerance in goal.goal_tolerance.items()},
    )


def _limit(given: float, default: float) -> float:
    """Resolves a tolerance of control_msgs: 0 is the default, negative is unlimited."""
    return math.inf if given < 0.0 else given or default
