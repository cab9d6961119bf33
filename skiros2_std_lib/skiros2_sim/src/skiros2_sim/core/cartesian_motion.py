"""Moves the tool of an arm on a straight line until it arrives or touches something:
skiros2_sim_msgs/CartesianMotion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_motion.core.arm_kinematics import ArmKinematics, distances
from skiros2_motion.core.geometry import IDENTITY, Pose, between, composed, inverted, normalized, rotated
from skiros2_motion.core.impedance import MAX_STIFFNESS, checked
from skiros2_motion.core.motion import Outcome, Pieces, State, advance
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.part_contacts import PartContacts
from skiros2_sim.core.physics import Joint

Array = npt.NDArray[np.float64]

#: Distance between solved poses (m, rad); joint positions are interpolated between them.
_STEP, _TURN_STEP = 0.01, 0.03
#: Maximum joint step (rad or m) between solved poses; a larger step would change the posture of the arm.
_LARGEST_JUMP = 0.25
#: Accelerations of the tool (m/s2, rad/s2), and maximum joint speed as a fraction of the joint's limit.
_ACCELERATION, _ANGULAR_ACCELERATION = 1.0, 3.0
_JOINT_SPEED = 0.8


class PathPoint(NamedTuple):
    """Target at a time: tool pose, joint positions and velocities, remaining distance (m)."""

    tool: Pose
    positions: Array
    velocities: Array
    to_go: float


class CartesianPath:
    """A straight path between two poses of the tool, with even rotation and a trapezoidal speed profile.

    :param positions: joint positions at equal distances along the path.
    :param speed: maximum speed of the tool (m/s), `angular_speed` (rad/s); reduced to respect joint limits.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        start: Pose,
        target: Pose,
        positions: Array,
        speed: float,
        angular_speed: float,
    ) -> None:
        self._start, self._target = start, target
        self._length, self._angle = distances(start, target)
        self._positions, self._steps = positions, np.diff(positions, axis=0)
        self._rate, self._ramp = self._profile(joints, speed, angular_speed)

    @classmethod
    def plan(
        cls,
        kinematics: ArmKinematics,
        joints: Sequence[Joint],
        start: Array,
        target: Pose,
        speed: float,
        angular_speed: float,
    ) -> Pieces[CartesianPath]:
        """Plans a path from the current pose to a target, in pieces of at most 1 ms.

        :param start: joint positions.
        :raises Refused: the target, or a pose on the path, is not reachable.
        """
        first, last = kinematics.forward(start), Pose(target.position, normalized(target.orientation))
        best = yield from kinematics.search(last, start)
        if not best.converged:
            raise Refused(
                f"no joint positions reach the target: the nearest are off by {best.off:.3f} m "
                f"and {best.turned:.3f} rad"
            )
        length, angle = distances(first, last)
        cells = max(1, math.ceil(length / _STEP), math.ceil(angle / _TURN_STEP))
        solved = [start]
        for k in range(1, cells + 1):
            yield
            found = kinematics.inverse(between(first, last, k / cells), solved[-1], restarts=0)
            jumps = np.abs(found.positions - solved[-1])
            if not found.converged or float(jumps.max()) > _LARGEST_JUMP:
                reason = _at_limits(kinematics, joints, found.positions) or "the arm would have to change its posture"
                raise Refused(
                    f"the straight path is not reachable beyond {k / cells * length:.3f} m of {length:.3f} m "
                    f"({reason}), though its target is"
                )
            solved.append(found.positions)
        return cls(joints, first, last, np.array(solved), speed, angular_speed)

    @property
    def duration(self) -> float:
        """s."""
        return self._ramp + 1.0 / self._rate if self._rate else 0.0

    def at(self, time: float, speed: float = 1.0) -> PathPoint:
        """Returns the target `time` seconds after the start; `speed` is the rate of time, for the velocities."""
        positions, velocities = self.joints_at(time, speed)
        s = self._along(time)[0]
        return PathPoint(between(self._start, self._target, s), positions, velocities, (1 - s) * self._length)

    def tool_at(self, time: float) -> Pose:
        """Returns the tool pose of `at`."""
        return between(self._start, self._target, self._along(time)[0])

    def joints_at(self, time: float, speed: float = 1.0) -> tuple[Array, Array]:
        """Returns the joint positions and velocities of `at`."""
        s, rate = self._along(time)
        cells = len(self._positions) - 1
        i = min(int(s * cells), cells - 1)
        step = self._steps[i]
        return self._positions[i] + (s * cells - i) * step, step * (cells * rate * speed)

    def _along(self, time: float) -> tuple[float, float]:
        """Returns the completed fraction of the path, and its rate (1/s)."""
        if time >= self.duration:
            return 1.0, 0.0
        if time <= 0.0:
            return 0.0, 0.0
        slope = self._rate / self._ramp
        left = self.duration - time
        if time < self._ramp:
            return slope * time**2 / 2, slope * time
        if left < self._ramp:
            return 1.0 - slope * left**2 / 2, slope * left
        return self._rate * (time - self._ramp / 2), self._rate

    def _profile(self, joints: Sequence[Joint], speed: float, angular_speed: float) -> tuple[float, float]:
        """Returns the rate (1/s) between the ramps, and the duration of a ramp (s)."""
        cells = len(self._positions) - 1
        fastest = np.max(np.abs(np.diff(self._positions, axis=0)), axis=0) * cells
        rates = [
            _JOINT_SPEED * joint.velocity / most
            for joint, most in zip(joints, fastest, strict=True)
            if most > 1e-9 and joint.velocity > 0.0
        ]
        accelerations = []
        if self._length > 1e-6:
            rates.append(speed / self._length)
            accelerations.append(_ACCELERATION / self._length)
        if self._angle > 1e-6:
            rates.append(angular_speed / self._angle)
            accelerations.append(_ANGULAR_ACCELERATION / self._angle)
        if not accelerations:
            return 0.0, 0.0
        acceleration = min(accelerations)
        # a short path ends before the full speed is reached
        rate = min(*rates, math.sqrt(acceleration)) if len(rates) > 1 else min(rates[0], math.sqrt(acceleration))
        return rate, rate / acceleration


def _at_limits(kinematics: ArmKinematics, joints: Sequence[Joint], positions: Array) -> str:
    """Names the joints that are at a limit."""
    at = [
        joint.name
        for joint, q, lower, upper in zip(joints, positions, kinematics.lower, kinematics.upper, strict=True)
        if q <= lower + 1e-3 or q >= upper - 1e-3
    ]
    return f"{' and '.join(at)} at its limit" if at else ""


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

#: Pieces of planning in a step: joint positions of a pose each, 0.05 ms, or at most 1 ms if there are none.
_PIECES = 5

#: Defaults for 0 in a goal: speeds (m/s, rad/s), maximum force and torque (N, Nm).
SPEED, ANGULAR_SPEED = 0.25, 1.0
MAX_FORCE, MAX_TORQUE = 80.0, 20.0
#: Maximum speeds of a goal (m/s, rad/s).
_FASTEST, _FASTEST_TURN = 2.0, 6.0
#: Maximum distance of a target (m).
_MAX_DISTANCE = 1000.0
#: Tolerances (m, rad) of the position controller and of the compliant controller.
_TOLERANCES = ((0.002, 0.01), (0.005, 0.03))
#: The motion is blocked with this path error under position control (m, rad), or without progress for this time (s).
_BEHIND, _TURNED_BEHIND = 0.03, 0.2
_NO_NEARER = 0.75
#: Maximum speed of a tool at rest (m/s), and minimum progress (m).
_AT_REST, _NEARER = 0.02, 0.0005
#: Factor by which the initial force may grow.
_GROWN = 1.1
#: Time constant of the force filter (s): single steps of the physics have peaks.
_FELT_OVER = 0.02
#: Braking time of a cancelled motion (s).
_BRAKING = 0.2
#: After a collision the arm retreats until the contact force is below this (N), for at most this time (s).
_PRESSED, _MAX_RETREAT = 5.0, 1.0


@dataclass(frozen=True)
class CartesianGoal:
    """A goal of skiros2_sim_msgs/CartesianMotion, with the target in the map. 0 and empty values are defaults."""

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


class ToolState(NamedTuple):
    """Pose of the tool in the map, wrench in the tool frame (N, Nm), and remaining distance (m)."""

    pose: Pose
    wrench: tuple[float, ...]
    distance: float


class CartesianMotion:
    """A motion on a straight line in the frame of the robot, which may drive meanwhile.

    The path is planned in the first steps; the arm does not move until then, nor if there is none (`UNREACHABLE`).
    """

    def __init__(self, controller: ArmController, goal: CartesianGoal) -> None:
        self.outcome: Outcome | None = None
        self._controller, self._arm, self._world = controller, controller.arm, controller.world
        self._goal = goal
        self._contacts = PartContacts(self._world, controller.arm_prefix)
        self._time = self._spent = 0.0
        self._speed = 1.0  # rate of time along the path; less while braking
        self._final_outcome: Outcome | None = None  # outcome after braking or retreat
        self._nearest, self._since = math.inf, 0.0
        self._retreat_time = 0.0  # s
        self._wrench: tuple[float, ...] = self._arm.wrench()
        self._is_planned = False
        self._base = self._from_map = IDENTITY  # of the robot in the map, and the inverse
        try:
            self._check()
        except SkirosError as error:
            self._end(State.REJECTED, INVALID_GOAL, str(error))
            return
        self._target = composed(inverted(controller.robot.pose()), goal.target)
        positions = np.array(self._arm.positions())
        speeds = goal.speed or SPEED, goal.angular_speed or ANGULAR_SPEED
        self._planning = CartesianPath.plan(controller.kinematics, self._arm.joints, positions, self._target, *speeds)
        if not self._is_at_rest():
            controller.hold()

    def feedback(self) -> ToolState:
        """Returns the current state."""
        pose = self._arm.tool_pose()
        return ToolState(pose, self._wrench, distances(pose, self._goal.target)[0])

    def update(self, dt: float) -> None:
        """Advances by `dt` seconds."""
        if self.outcome is not None:
            return
        if not self._is_planned:
            self._plan()
            return
        share = min(1.0, dt / _FELT_OVER)
        pairs = zip(self._wrench, self._arm.wrench(), strict=True)
        self._wrench = tuple([old + (new - old) * share for old, new in pairs])
        self._spent += dt
        if self._final_outcome is None:
            tool = self._arm.tool_pose()
            self._final_outcome = self._force_exceeded(tool) or self._check_progress(tool, dt)
        if self._final_outcome is None:
            self._go_on(dt)
        elif self._final_outcome.state is State.PREEMPTED and self._speed > 0.0:
            self._speed = max(0.0, self._speed - dt / _BRAKING)
            self._go_on(dt)
        elif self._final_outcome.code in _RAN_INTO and self._presses():
            self._retreat_time += dt
            self._time = max(0.0, self._time - dt)
            self._command(0.0)
        else:
            self.outcome = self._final_outcome

    def cancel(self) -> None:
        """Brakes along the line."""
        if not self._is_planned:
            self._end(State.PREEMPTED, PREEMPTED, "cancelled")
        elif self._final_outcome is None:
            self._final_outcome = Outcome(State.PREEMPTED, "cancelled", PREEMPTED)

    def _plan(self) -> None:
        """Plans for one step of the world, and starts the motion at the end."""
        try:
            path = advance(self._planning, _PIECES)
        except Refused as error:
            self._end(State.ABORTED, UNREACHABLE, str(error))
            return
        if path is None:
            return
        self._path, self._is_planned = path, True
        self._wrench = self._arm.wrench()
        # the initial force must not prevent a retreat from a contact
        self._initial_forces = math.hypot(*self._wrench[:3]), math.hypot(*self._wrench[3:])
        # contact force is measured relative to the weight of a carried object, in the map
        self._carried = rotated(self._arm.tool_pose().orientation, self._arm.wrench()[:3])
        self._contacts.restart()
        self._controller.switch(self._goal.controller or self._controller.active)
        self._controller.payload.carry()
        if self._goal.stiffness:
            self._controller.stiffness = tuple(self._goal.stiffness)

    def _is_at_rest(self) -> bool:
        return math.hypot(*self._arm.tool_velocity()[0]) < _AT_REST

    def _go_on(self, dt: float) -> None:
        self._time += self._speed * dt
        self._command(self._speed)

    def _presses(self) -> bool:
        """Whether to retreat farther. A compliant arm yields by itself."""
        if self._controller.compliant or self._retreat_time >= _MAX_RETREAT or self._time <= 0.0:
            return False
        return sum(self._contacts.new().values()) > _PRESSED

    def _command(self, speed: float) -> None:
        if self._controller.compliant:
            point = self._path.at(self._time, speed)
            self._controller.draw(point.tool, point.positions, point.velocities)
        else:
            self._controller.follow(*self._path.joints_at(self._time, speed))

    def _force_exceeded(self, tool: Pose) -> Outcome | None:
        """Returns the outcome if a force limit or the requested contact force is reached.

        :param tool: its pose in the map.
        """
        if self._controller.stop is not None:
            return self._stop(State.ABORTED, FORCE_LIMIT, f"{self._controller.stop}{self._contacts.describe()}")
        force, torque = math.hypot(*self._wrench[:3]), math.hypot(*self._wrench[3:])
        if self._goal.contact_force > 0.0:
            contact = math.dist(rotated(tool.orientation, self._wrench[:3]), self._carried)
            if contact >= self._goal.contact_force:
                text = f"contact of {contact:.1f} N{self._contacts.describe()}"
                return self._stop(State.SUCCEEDED, SUCCESSFUL, text)
        for felt, at_first, limit, what in (
            (force, self._initial_forces[0], self._goal.max_force or MAX_FORCE, "N"),
            (torque, self._initial_forces[1], self._goal.max_torque or MAX_TORQUE, "Nm"),
        ):
            if felt > max(limit, _GROWN * at_first):
                text = f"felt {felt:.1f} {what}, {limit:g} {what} are allowed{self._contacts.describe()}"
                return self._stop(State.ABORTED, FORCE_LIMIT, text)
        return None

    def _check_progress(self, tool: Pose, dt: float) -> Outcome | None:
        """Returns the outcome if the tool has arrived, is blocked, or the timeout has passed."""
        base = self._controller.robot.pose()
        if base != self._base:
            self._base, self._from_map = base, inverted(base)
        pose = composed(self._from_map, tool)
        if not self._controller.compliant:
            behind, turned_behind = distances(pose, self._path.tool_at(self._time))
            if behind > _BEHIND or turned_behind > _TURNED_BEHIND:
                text = f"the tool is {behind:.3f} m and {turned_behind:.3f} rad behind{self._contacts.describe()}"
                return self._stop(State.ABORTED, BLOCKED, text)
        if self._spent > (self._goal.timeout or 2 * self._path.duration + 2.0):
            left = distances(pose, self._target)
            remaining = f"{left[0]:.3f} m and {left[1]:.3f} rad remain"
            text = f"not at the target after {self._spent:.2f} s: {remaining}{self._contacts.describe()}"
            return self._stop(State.ABORTED, TIMED_OUT, text)
        if self._time < self._path.duration:
            return None
        return self._at_the_end(pose, dt)

    def _at_the_end(self, pose: Pose, dt: float) -> Outcome | None:
        if self._nearest == math.inf:  # includes an object grasped on the way
            self._controller.payload.carry()
        off, turned = distances(pose, self._target)
        speed = math.hypot(*self._arm.tool_velocity()[0])
        own = _TOLERANCES[int(self._controller.compliant)]
        near = off <= (self._goal.position_tolerance or own[0])
        if near and turned <= (self._goal.orientation_tolerance or own[1]) and speed < _AT_REST:
            if self._goal.contact_force > 0.0:
                text = f"at the end of the line without a contact of {self._goal.contact_force:g} N"
                return self._stop(State.ABORTED, NO_CONTACT, text)
            return self._stop(State.SUCCEEDED, SUCCESSFUL, "")
        if off + turned < self._nearest - _NEARER:
            self._nearest, self._since = off + turned, 0.0
        self._since += dt
        if self._since > _NO_NEARER:
            text = f"the tool stays {off:.3f} m and {turned:.3f} rad from its target{self._contacts.describe()}"
            return self._stop(State.ABORTED, BLOCKED, text)
        return None

    def _stop(self, state: State, code: int, text: str) -> Outcome:
        """Holds the arm at its position or at the end of its path."""
        if code in (*_RAN_INTO, TIMED_OUT) or self._time < self._path.duration:
            self._controller.hold()
        return Outcome(state, text, code)

    def _end(self, state: State, code: int, text: str) -> None:
        self.outcome = Outcome(state, text, code)

    def _check(self) -> None:
        """Checks the goal.

        :raises WrongValue: a number is out of range.
        :raises UnknownName: a controller does not exist.
        """
        goal = self._goal
        if not all(map(math.isfinite, (*goal.target.position, *goal.target.orientation))):
            raise WrongValue(f"target {goal.target} has numbers that are not finite")
        if max(map(abs, goal.target.position)) > _MAX_DISTANCE:
            raise WrongValue(f"target at {goal.target.position} is farther than {_MAX_DISTANCE:g} m away")
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
            checked("stiffness", goal.stiffness, MAX_STIFFNESS, lowest=0.0)
