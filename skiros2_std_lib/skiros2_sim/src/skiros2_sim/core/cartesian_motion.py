"""The tool of an arm on a straight line, until it is there or touches something: skiros2_sim_msgs/CartesianMotion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_sim.core.arm_controller import ArmController, checked_stiffness
from skiros2_sim.core.arm_kinematics import distances
from skiros2_sim.core.cartesian_path import CartesianPath, Moment
from skiros2_sim.core.motion import Outcome, State
from skiros2_sim.core.touching import because, new_touches, touched
from skiros2_std_reasoners.core.geometry import Pose, composed, inverted, rotated

Array = npt.NDArray[np.float64]

#: Codes of the action's result.
SUCCESSFUL = 0
INVALID_GOAL = -1
UNREACHABLE = -2
FORCE_LIMIT = -3
NO_CONTACT = -4
TIMED_OUT = -5
BLOCKED = -6
PREEMPTED = -7
_RAN_INTO = (FORCE_LIMIT, BLOCKED)

#: The arm's own numbers, where a goal has 0: speeds (m/s, rad/s), the most it may feel (N, Nm).
SPEED, ANGULAR_SPEED = 0.25, 1.0
MAX_FORCE, MAX_TORQUE = 80.0, 20.0
#: Nobody asks an arm for more (m/s, rad/s).
_FASTEST, _FASTEST_TURN = 2.0, 6.0
#: No target is farther off (m).
_FARTHEST = 1000.0
#: How near it comes (m, rad) under position control and when it is compliant.
_TOLERANCES = ((0.002, 0.01), (0.005, 0.03))
#: It is blocked when it is that far behind under position control (m, rad), or gets no nearer for so long (s).
_BEHIND, _TURNED_BEHIND = 0.03, 0.2
_NO_NEARER = 0.75
#: Speed below which it stands (m/s), and how much nearer counts as nearer (m).
_AT_REST, _NEARER = 0.02, 0.0005
#: By how much what it felt at its start may grow.
_GROWN = 1.1
#: Over how long what it feels is averaged (s): single steps of the physics have peaks.
_FELT_OVER = 0.02
#: How long braking takes when it is cancelled (s).
_BRAKING = 0.2
#: When it has run into something it goes back until that presses no more than this (N), at most so far in time (s).
_PRESSED, _GOES_BACK = 5.0, 1.0


@dataclass(frozen=True)
class CartesianGoal:
    """What skiros2_sim_msgs/CartesianMotion asks for; the target is in the map. 0 and empty: the arm's own."""

    target: Pose
    speed: float = 0.0
    angular_speed: float = 0.0
    controller: str = ""
    stiffness: Sequence[float] = ()
    max_force: float = 0.0
    max_torque: float = 0.0
    contact_force: float = 0.0
    position_tolerance: float = 0.0
    orientation_tolerance: float = 0.0
    timeout: float = 0.0


class Feeling(NamedTuple):
    """Where the tool is in the map, what it feels in its own frame (N, Nm), and m to go."""

    pose: Pose
    wrench: tuple[float, ...]
    distance: float


class CartesianMotion:
    """A motion on a straight line, in the frame of the robot: a base that drives takes it along."""

    def __init__(self, controller: ArmController, goal: CartesianGoal) -> None:
        self.outcome: Outcome | None = None
        self._controller, self._arm, self._world = controller, controller.arm, controller.world
        self._goal = goal
        self._part = f"{controller.robot.name}/{self._arm.name}/"
        self._time = self._spent = 0.0
        self._speed = 1.0  # at which time goes on along the path; less while it brakes
        self._ended: Outcome | None = None  # what comes out when it has braked
        self._nearest, self._since = math.inf, 0.0
        self._back = 0.0  # s that it has gone back
        self._felt = np.array(self._arm.wrench())
        # what presses on it at its start does not keep it from going away
        self._at_first = float(np.linalg.norm(self._felt[:3])), float(np.linalg.norm(self._felt[3:]))
        # what it carries pulls on it from the start on: contact is what it feels beyond that, in the map
        self._carried = np.array(rotated(self._arm.tool_pose().orientation, self._arm.wrench()[:3]))
        self._touched = touched(self._world, self._part)
        try:
            self._check()
            self._target = composed(inverted(controller.robot.pose()), goal.target)
            self._path = CartesianPath(
                controller.kinematics,
                self._arm.joints,
                np.array(self._arm.positions()),
                self._target,
                goal.speed or SPEED,
                goal.angular_speed or ANGULAR_SPEED,
            )
            controller.switch(goal.controller or controller.active)
            controller.carry()
            if goal.stiffness:
                controller.stiffness = tuple(goal.stiffness)
        except Refused as error:
            self._end(State.REJECTED, UNREACHABLE, str(error))
        except SkirosError as error:
            self._end(State.REJECTED, INVALID_GOAL, str(error))

    def feedback(self) -> Feeling:
        """As of now."""
        pose = self._arm.tool_pose()
        return Feeling(pose, tuple(self._felt.tolist()), distances(pose, self._goal.target)[0])

    def update(self, dt: float) -> None:
        """Goes on by `dt` seconds."""
        if self.outcome is not None:
            return
        self._felt += (np.array(self._arm.wrench()) - self._felt) * min(1.0, dt / _FELT_OVER)
        self._spent += dt
        if self._ended is None:
            self._ended = self._felt_too_much() or self._kept_from_it(dt)
        if self._ended is None:
            self._go_on(dt)
        elif self._ended.state is State.PREEMPTED and self._speed > 0.0:
            self._speed = max(0.0, self._speed - dt / _BRAKING)
            self._go_on(dt)
        elif self._ended.code in _RAN_INTO and self._presses():
            self._back += dt
            self._time = max(0.0, self._time - dt)
            self._command(self._path.at(self._time, 0.0))
        else:
            self.outcome = self._ended

    def cancel(self) -> None:
        """Brakes along the line."""
        if self._ended is None:
            self._ended = Outcome(State.PREEMPTED, "cancelled", PREEMPTED)

    def _go_on(self, dt: float) -> None:
        self._time += self._speed * dt
        self._command(self._path.at(self._time, self._speed))

    def _presses(self) -> bool:
        """Whether it is to go back farther; a compliant arm has given way already."""
        if self._controller.compliant or self._back >= _GOES_BACK or self._time <= 0.0:
            return False
        return sum(new_touches(self._world, self._part, self._touched).values()) > _PRESSED

    def _command(self, moment: Moment) -> None:
        if self._controller.compliant:
            self._controller.draw(moment.tool, moment.positions, moment.velocities)
        else:
            self._controller.follow(moment.positions, moment.velocities)

    def _felt_too_much(self) -> Outcome | None:
        """The end for what it feels: too much, or the contact that it looks for."""
        force, torque = float(np.linalg.norm(self._felt[:3])), float(np.linalg.norm(self._felt[3:]))
        in_map = np.array(rotated(self._arm.tool_pose().orientation, self._felt[:3].tolist()))
        contact = float(np.linalg.norm(in_map - self._carried))
        if 0.0 < self._goal.contact_force <= contact:
            return self._stop(State.SUCCEEDED, SUCCESSFUL, f"contact of {contact:.1f} N{self._reason()}")
        for felt, at_first, limit, what in (
            (force, self._at_first[0], self._goal.max_force or MAX_FORCE, "N"),
            (torque, self._at_first[1], self._goal.max_torque or MAX_TORQUE, "Nm"),
        ):
            if felt > max(limit, _GROWN * at_first):
                text = f"felt {felt:.1f} {what}, {limit:g} {what} are allowed{self._reason()}"
                return self._stop(State.ABORTED, FORCE_LIMIT, text)
        return None

    def _kept_from_it(self, dt: float) -> Outcome | None:
        """The end for where it is: there, or not getting there."""
        pose = self._controller.tool_pose()
        if not self._controller.compliant:
            behind, turned_behind = distances(pose, self._path.at(self._time).tool)
            if behind > _BEHIND or turned_behind > _TURNED_BEHIND:
                text = f"the tool is {behind:.3f} m and {turned_behind:.3f} rad behind{self._reason()}"
                return self._stop(State.ABORTED, BLOCKED, text)
        if self._spent > (self._goal.timeout or 2 * self._path.duration + 2.0):
            left = distances(pose, self._target)
            text = f"not there after {self._spent:.2f} s: {left[0]:.3f} m and {left[1]:.3f} rad to go{self._reason()}"
            return self._stop(State.ABORTED, TIMED_OUT, text)
        if self._time < self._path.duration:
            return None
        return self._at_the_end(pose, dt)

    def _at_the_end(self, pose: Pose, dt: float) -> Outcome | None:
        if self._nearest == math.inf:  # what it has taken up on its way
            self._controller.carry()
        off, turned = distances(pose, self._target)
        speed = math.hypot(*self._arm.tool_velocity()[0])
        own = _TOLERANCES[int(self._controller.compliant)]
        near = off <= (self._goal.position_tolerance or own[0])
        if near and turned <= (self._goal.orientation_tolerance or own[1]) and speed < _AT_REST:
            if self._goal.contact_force > 0.0:
                text = f"at its end without a contact of {self._goal.contact_force:g} N"
                return self._stop(State.ABORTED, NO_CONTACT, text)
            return self._stop(State.SUCCEEDED, SUCCESSFUL, "")
        if off + turned < self._nearest - _NEARER:
            self._nearest, self._since = off + turned, 0.0
        self._since += dt
        if self._since > _NO_NEARER:
            text = f"the tool stays {off:.3f} m and {turned:.3f} rad from its target{self._reason()}"
            return self._stop(State.ABORTED, BLOCKED, text)
        return None

    def _stop(self, state: State, code: int, text: str) -> Outcome:
        """Stands still where it is, or at the end of its line."""
        if code in (*_RAN_INTO, TIMED_OUT) or self._time < self._path.duration:
            self._controller.hold()
        return Outcome(state, text, code)

    def _reason(self) -> str:
        return because(new_touches(self._world, self._part, self._touched))

    def _end(self, state: State, code: int, text: str) -> None:
        self.outcome = Outcome(state, text, code)

    def _check(self) -> None:
        """Raises WrongValue and UnknownName for numbers and names that cannot be."""
        goal = self._goal
        if not all(map(math.isfinite, (*goal.target.position, *goal.target.orientation))):
            raise WrongValue(f"target {goal.target} has numbers that are none")
        if max(map(abs, goal.target.position)) > _FARTHEST:
            raise WrongValue(f"target at {goal.target.position} is farther than {_FARTHEST:g} m away")
        length = math.hypot(*goal.target.orientation)
        if abs(length - 1.0) > 0.01:
            raise WrongValue(f"orientation of the target {goal.target.orientation}: length {length:.3f}, expected 1")
        for name, most in (
            ("speed", _FASTEST),
            ("angular_speed", _FASTEST_TURN),
            ("max_force", math.inf),
            ("max_torque", math.inf),
            ("contact_force", goal.max_force or MAX_FORCE),
            ("position_tolerance", math.inf),
            ("orientation_tolerance", math.inf),
            ("timeout", math.inf),
        ):
            value = getattr(goal, name)
            if not math.isfinite(value) or not 0.0 <= value <= most:
                raise WrongValue(f"{name} {value}: expected a number from 0 to {most:g}")
        if goal.controller and goal.controller not in self._controller.names:
            names = " and ".join(self._controller.names)
            raise WrongValue(f"arm {self._arm.name} has no controller {goal.controller!r}; it has {names}")
        if goal.stiffness:
            checked_stiffness(goal.stiffness)
