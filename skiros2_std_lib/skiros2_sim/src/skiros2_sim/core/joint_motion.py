"""The joints of an arm along a trajectory: what a driver's control_msgs/FollowJointTrajectory does."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeGuard

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.joint_path import JointGoal, JointPath, JointTolerance
from skiros2_sim.core.motion import Outcome, State
from skiros2_sim.core.touching import because, new_touches, touched

Array = npt.NDArray[np.float64]

#: Codes of the action's result.
SUCCESSFUL = 0
INVALID_GOAL = -1
INVALID_JOINTS = -2
OLD_HEADER_TIMESTAMP = -3
PATH_TOLERANCE_VIOLATED = -4
GOAL_TOLERANCE_VIOLATED = -5

#: Where a goal does not say it: how far a joint may be off on the way and at the end (rad or m), how fast it may still
#: be there (per second), and how long after its time it may arrive (s).
_PATH, _GOAL, _AT_REST, _GOAL_TIME = 0.1, 0.01, 0.05, 2.0
#: How long braking takes when it is cancelled (s).
_BRAKING = 0.25
#: When it has run into something it goes back until that presses no more than this (N), at most so far in time (s).
_PRESSED, _GOES_BACK = 5.0, 1.0


class JointState(NamedTuple):
    """Of all joints: positions (rad or m) and velocities, in the order of the arm."""

    positions: Array
    velocities: Array


class JointMotion:
    """A motion along a trajectory. One that is to begin later waits for its time; of one that began in the past, the
    points that are still to come are driven to."""

    def __init__(self, controller: ArmController, goal: JointGoal) -> None:
        self.outcome: Outcome | None = None
        self._controller = controller
        self._arm = controller.arm
        self._goal = _with_full_names(goal, self._arm.name)
        self._speed = 1.0  # at which time goes on along the path; less while it brakes
        self._brakes = False
        self._ending: Outcome | None = None  # what comes out when it has gone back
        self._back = 0.0  # s that it has gone back
        self._touched: dict[str, float] = {}
        self._part = f"{controller.robot.name}/{self._arm.name}/"
        self._actual = self._state()
        #: Where it is on its path (s); before it begins: below 0.
        self._time = min(0.0, controller.world.time - goal.start) if _is_finite(goal.start) else 0.0
        self._path: JointPath | None = None
        try:
            self._path = self._checked()
        except UnknownName as error:
            self._end(State.REJECTED, INVALID_JOINTS, str(error))
        except WrongValue as error:
            self._end(State.REJECTED, INVALID_GOAL, str(error))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the order of the feedback, without the arm's name."""
        return tuple(joint.name.removeprefix(self._arm.name + "/") for joint in self._arm.joints)

    def feedback(self) -> tuple[JointState, JointState, JointState]:
        """What is wanted, what is, and the difference, as of the last step."""
        desired = self._desired()
        actual = self._actual
        return desired, actual, JointState(*(w - a for w, a in zip(desired, actual, strict=True)))

    def update(self, dt: float) -> None:
        """Goes on by `dt` seconds."""
        if self.outcome is not None or self._path is None:
            return
        self._actual = self._state()
        if self._controller.compliant:
            self._end(State.ABORTED, INVALID_GOAL, f"controller {self._controller.active!r} was switched on meanwhile")
        elif self._ending is not None:
            self._go_back(dt)
        elif self._time >= 0.0 and (reason := self._off_the_path()):
            self._controller.hold()
            self._ending = Outcome(State.ABORTED, reason + because(self._new_touches()), PATH_TOLERANCE_VIOLATED)
        elif self._brakes:
            self._brake(dt)
        elif self._time >= self._path.duration:
            self._arrive(dt)
        else:
            if self._time <= 0.0:
                self._touched = touched(self._controller.world, self._part)
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
        """Ends when all joints are where the last point wants them, or when the time for that is over."""
        assert self._path is not None
        self._time += dt
        self._controller.follow(*self._desired())
        late = self._time - self._path.duration
        off = self._off_the_goal()
        if not off:
            self._end(State.SUCCEEDED, SUCCESSFUL, "")
        elif late > (self._goal.goal_time_tolerance or _GOAL_TIME):
            off += because(self._new_touches())
            self._end(State.ABORTED, GOAL_TOLERANCE_VIOLATED, f"{late:.2f} s after the trajectory's end: {off}")

    def _go_back(self, dt: float) -> None:
        """Back the way that it came, until it does not press on what it ran into; then it holds still."""
        if self._back < _GOES_BACK and self._time > 0.0 and sum(self._new_touches().values()) > _PRESSED:
            self._back += dt
            self._time = max(0.0, self._time - dt)
            self._controller.follow(self._desired().positions, np.zeros(len(self._arm.joints)))
        else:
            self.outcome = self._ending

    def _new_touches(self) -> dict[str, float]:
        return new_touches(self._controller.world, self._part, self._touched)

    def _off_the_path(self) -> str:
        """Which joint is farther from the path than it may be."""
        desired = self._desired()
        for i, joint in enumerate(self._arm.joints):
            tolerance = self._goal.path_tolerance.get(joint.name, JointTolerance())
            off = abs(desired.positions[i] - self._actual.positions[i])
            if off > _limit(tolerance.position, _PATH):
                return f"{joint.name} is {off:.4f} off the path, {_limit(tolerance.position, _PATH):g} is allowed"
            faster = abs(desired.velocities[i] - self._actual.velocities[i])
            if faster > _limit(tolerance.velocity, math.inf):
                return f"{joint.name} is {faster:.4f} per second off its speed, {tolerance.velocity:g} is allowed"
        return ""

    def _off_the_goal(self) -> str:
        """Which joint is not where it is to be at the end."""
        desired = self._desired()
        for i, joint in enumerate(self._arm.joints):
            tolerance = self._goal.goal_tolerance.get(joint.name, JointTolerance())
            off = abs(desired.positions[i] - self._actual.positions[i])
            if off > _limit(tolerance.position, _GOAL):
                return f"{joint.name} is {off:.4f} off its goal, {_limit(tolerance.position, _GOAL):g} is allowed"
            speed = abs(self._actual.velocities[i])
            if speed > _limit(tolerance.velocity, _AT_REST):
                return f"{joint.name} still moves at {speed:.4f} per second"
        return ""

    def _desired(self) -> JointState:
        if self._path is None:
            return self._actual
        positions, velocities = self._path.at(self._time)
        return JointState(positions, velocities * self._speed)

    def _state(self) -> JointState:
        return JointState(np.array(self._arm.positions()), np.array(self._arm.velocities()))

    def _checked(self) -> JointPath | None:
        """The path of the goal; None when it is refused for its time. Raises WrongValue and UnknownName."""
        controller, goal = self._controller, self._goal
        if controller.compliant:
            raise WrongValue(
                f"controller {controller.active!r} of arm {self._arm.name} is on; a trajectory needs "
                f"{controller.names[0]!r}: switch to it first"
            )
        for kind, tolerances in (("path", goal.path_tolerance), ("goal", goal.goal_tolerance)):
            for name, tolerance in tolerances.items():
                if not all(map(math.isfinite, (tolerance.position, tolerance.velocity))):
                    raise WrongValue(f"{kind} tolerance of {name} is {tolerance}, which is no number")
        if not _is_finite(goal.goal_time_tolerance) or goal.goal_time_tolerance < 0.0:
            raise WrongValue(f"goal time tolerance {goal.goal_time_tolerance}: expected seconds, 0 or more")
        if goal.start is not None and not math.isfinite(goal.start):
            raise WrongValue(f"start {goal.start} is no time")
        # all of it is looked at, also what is over by now
        path = JointPath(goal, self._arm.joints, *self._actual)
        over = controller.world.time - goal.start if goal.start is not None else 0.0
        if over > 0.0:
            left = tuple(replace(p, time=p.time - over) for p in goal.points if p.time > over)
            if not left:
                text = f"the trajectory was to begin {over:.3f} s ago and to end {over - path.duration:.3f} s ago"
                self._end(State.REJECTED, OLD_HEADER_TIMESTAMP, text)
                return None
            path = JointPath(replace(goal, points=left), self._arm.joints, *self._actual)
        for joint, start, actual in zip(self._arm.joints, path.start, self._actual.positions, strict=True):
            if abs(start - actual) > _PATH:
                raise WrongValue(
                    f"the trajectory begins at once with {joint.name} at {start:.4f}, which is at {actual:.4f}"
                )
        return path

    def _end(self, state: State, code: int, text: str) -> None:
        self.outcome = Outcome(state, text, code)


def _with_full_names(goal: JointGoal, arm: str) -> JointGoal:
    """A goal with its joints named as the model does, `ARM/joint`; drivers of one arm leave the arm out."""

    def full(name: str) -> str:
        return name if name.startswith(arm + "/") else f"{arm}/{name}"

    return replace(
        goal,
        joints=tuple(full(name) for name in goal.joints),
        path_tolerance={full(name): tolerance for name, tolerance in goal.path_tolerance.items()},
        goal_tolerance={full(name): tolerance for name, tolerance in goal.goal_tolerance.items()},
    )


def _limit(given: float, default: float) -> float:
    """A tolerance as control_msgs means it: 0 is the default, below 0 is none."""
    return math.inf if given < 0.0 else given or default


def _is_finite(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)
