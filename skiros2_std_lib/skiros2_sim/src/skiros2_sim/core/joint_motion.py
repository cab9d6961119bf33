"""Moves the joints of an arm along a trajectory, as a driver of control_msgs/FollowJointTrajectory does."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeGuard

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.contacts import PartContacts
from skiros2_sim.core.joint_path import JointGoal, JointPath, JointTolerance
from skiros2_sim.core.motion import Outcome, State

Array = npt.NDArray[np.float64]

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
        """The joints in the order of the feedback, without the prefix of the arm."""
        return tuple(joint.name.removeprefix(self._arm.name + "/") for joint in self._arm.joints)

    def feedback(self) -> tuple[JointState, JointState, JointState]:
        """Returns desired state, actual state and error of the last step."""
        desired = self._desired()
        actual = self._actual
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
            text = reason + self._contacts.describe()
            self._final_outcome = Outcome(State.ABORTED, text, PATH_TOLERANCE_VIOLATED)
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
        """Returns a description of a violated path tolerance; "" without one."""
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
        """Returns a description of a violated goal tolerance; "" without one."""
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
        """Returns the path of the goal; None if its time is over.

        :raises WrongValue: a number is invalid.
        :raises UnknownName: a joint does not exist.
        """
        controller, goal = self._controller, self._goal
        if controller.compliant:
            raise WrongValue(
                f"controller {controller.active!r} of arm {self._arm.name} is active; a trajectory needs "
                f"{controller.names[0]!r}: switch to it first"
            )
        for kind, tolerances in (("path", goal.path_tolerance), ("goal", goal.goal_tolerance)):
            for name, tolerance in tolerances.items():
                if not all(map(math.isfinite, (tolerance.position, tolerance.velocity))):
                    raise WrongValue(f"{kind} tolerance of {name} is {tolerance}, which is not finite")
        if not _is_finite(goal.goal_time_tolerance) or goal.goal_time_tolerance < 0.0:
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
        for joint, start, actual in zip(self._arm.joints, path.start, self._actual.positions, strict=True):
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


def _is_finite(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)
