"""Controllers of an arm's joints: a position controller and a compliant one, which can be switched during motion.

The compliant one is a Cartesian impedance (see `impedance`), with an overlay motion. Each has limits of the
measured wrench. Poses are those of the tool in the robot's frame.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_motion.core.arm_kinematics import ArmKinematics, ChainJoint
from skiros2_motion.core.compliant_arm import checked_limits
from skiros2_motion.core.geometry import Pose, Vector, composed, inverted
from skiros2_motion.core.impact import apparent_mass
from skiros2_motion.core.impedance import ArmState, Impedance
from skiros2_motion.core.motion import Outcome
from skiros2_motion.core.spiral import Spiral, SpiralGoal
from skiros2_motion.core.wrench_guard import (
    NOT_FINITE,
    Balance,
    Limits,
    Violation,
    WrenchGuard,
    is_finite,
    is_limit,
    violation_text,
)
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.force_regulation import ForceRegulation
from skiros2_sim.core.hand_force import HandForce
from skiros2_sim.core.payload import Payload
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.world import World

log = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]

#: Minimum rate of the compliant controller (Hz), if the world has as many steps.
CONTROL_RATE = 500
#: Default damping factors: about critical damping with the inertia of an arm, which is 2 to 8 kg at its tool.
_DAMPING_FACTORS = (2.0,) * 6
#: Maximum distance of a reference from the robot's frame (m).
_MAX_REACH = 3.0


class Stop(NamedTuple):
    """A stop at a limit of the wrench, or because a sensor cannot be trusted.

    :param quantity: as of `wrench_guard.Violation`.
    :param time: simulated time (s).
    """

    quantity: str
    value: float
    limit: float
    time: float

    @property
    def kind(self) -> FailureKind:
        """`LIMIT` for a force or torque, else `SENSOR`."""
        return FailureKind.LIMIT if is_limit(self.quantity) else FailureKind.SENSOR

    def __str__(self) -> str:
        return violation_text(self.quantity, self.value, self.limit)


class ArmController:
    """The controllers of one arm; one instance per arm. The position controller is active first."""

    def __init__(self, world: World, robot: Robot, arm: Arm) -> None:
        self.world, self.robot, self.arm = world, robot, arm
        self.kinematics = _kinematics(world, robot, arm)
        self.outcome: Outcome | None = None
        self.compliant = False
        #: The law of the compliant controller.
        self.impedance = Impedance(arm.max_efforts, (self.kinematics.lower, self.kinematics.upper))
        self.impedance.set_damping_factors(_DAMPING_FACTORS)
        #: The loop for forces; `check_active` comes before a new goal.
        self.force = ForceRegulation(self.impedance)
        self.overlay: Spiral | None = None
        #: Limits of the measured wrench under compliant and under position control.
        self.limits = self.position_limits = Limits()
        #: Time until the commanded wrench expires (s).
        self._wrench_time = math.inf
        #: The stop at a limit, since which the arm holds.
        self.stop: Stop | None = None
        #: The checks of the measured wrench.
        self.guard = WrenchGuard(arm.sensor is not None and arm.sensor.is_noisy)
        #: The last state of the compliant controller, and whether the motors hold its positions: there are no torques.
        self._last: ArmState | None = None
        self._is_held = False
        #: Number of steps between two updates of the torques.
        self._period = max(1, world.rate // CONTROL_RATE)
        self._steps = 0
        self._masses = np.eye(len(arm.joints))
        self.payload = Payload(robot, arm)
        self.hand = HandForce(arm, self.payload, world.dt)

    @property
    def names(self) -> tuple[str, str]:
        """Names of the position controller and the compliant controller."""
        return self.arm.spec.position_controller, self.arm.spec.compliant_controller

    @property
    def arm_prefix(self) -> str:
        """Name prefix of the links of the arm, as in contacts: ROBOT/ARM/."""
        return f"{self.robot.name}/{self.arm.name}/"

    @property
    def active(self) -> str:
        """Name of the active controller."""
        return self.names[int(self.compliant)]

    @property
    def stiffness(self) -> tuple[float, ...]:
        """Stiffness of the compliant controller: N/m along and Nm/rad about the axes of the tool frame."""
        return self.impedance.commanded_stiffness

    @stiffness.setter
    def stiffness(self, values: Sequence[float]) -> None:
        self.impedance.set_stiffness(values)

    def switch(self, name: str) -> None:
        """Activates a controller and deactivates the other. The arm keeps its position and its load.

        :raises UnknownName: the arm has no such controller.
        """
        if name not in self.names:
            raise UnknownName(f"arm {self.arm.name} has no controller {name!r}; it has {' and '.join(self.names)}")
        if name == self.active:
            return
        self.compliant = not self.compliant
        self.overlay = self.stop = None
        self._is_held = False
        self.guard.restart()
        self.force.set_goal(None)
        if self.compliant:
            self._steps, self._last = 0, None
            self._restart()
        else:
            self.hold()
        self._update_often()

    def _restart(self) -> None:
        """Starts the law at the measured pose; the arm stops if its state is not finite."""
        state = self._state()
        try:
            self.impedance.restart(state)
        except WrongValue as error:
            self._fail(error)
            return
        self._last = state
        self.impedance.limits = self.limits
        self.payload.carry()

    def zero_sensor(self) -> None:
        """Makes the current measured wrench the zero of the following ones, and compensates the weight of the object in
        the hand from now on.

        :raises Refused: the arm has no sensor.
        """
        if not is_finite(self.arm.measured_wrench()):
            raise Refused(f"arm {self.arm.name}: the measured wrench is not finite: {self.arm.measured_wrench()}")
        self.arm.zero_sensor()
        self.payload.zero()
        if self.compliant:
            self.payload.carry()

    def hold(self) -> None:
        """Holds the current position; if it is not finite, the position motors hold the last one that was known."""
        positions = np.array(self.arm.positions())
        if self._is_held or not is_finite(positions):
            if self._last is not None:
                self.follow(self._last.positions, np.zeros(len(positions)))
        elif self.compliant:
            self.draw(self.tool_pose(), positions, np.zeros(len(positions)))
        else:
            self.follow(positions, np.zeros(len(positions)))

    def follow(self, positions: Array, velocities: Array) -> None:
        """Sets the targets of the position controller."""
        self.arm.drive(positions.tolist(), velocities.tolist())

    def draw(self, tool: Pose, posture: Array, velocities: Array) -> None:
        """Sets the targets of the compliant controller on a smooth path: tool pose, posture of the joints (in the
        nullspace) and joint velocities. Does nothing after a stop."""
        if self.stop is None:
            self.impedance.set_reference(self.force.controlled(tool), filtered=False)
            self.impedance.posture, self.impedance.velocities = posture, velocities

    def tool_pose(self) -> Pose:
        """Pose of the tool in the robot's frame."""
        return composed(inverted(self.robot.pose()), self.arm.tool_pose())

    def apparent_mass(self, direction: Vector) -> float:
        """Returns the mass of the tool along a direction in the robot's frame (kg)."""
        joints = self.arm.dynamics(with_masses=True)
        return apparent_mass(self.kinematics.jacobian(joints.positions), np.array(joints.masses), direction)

    # -- commands to the compliant controller -----------------------------------------------------------------

    def set_reference(self, pose: Pose) -> None:
        """Sets the pose that attracts the tool; the arm holds it until the next one.

        :raises WrongValue: it is far out of reach.
        :raises Refused: the controller is not active, or has stopped at a limit.
        """
        if not all(abs(value) <= _MAX_REACH for value in pose.position):
            raise WrongValue(f"position {pose.position} in the robot's frame: expected up to {_MAX_REACH:g} m")
        self.check_active()
        self.impedance.set_reference(self.force.commanded(pose))
        self.impedance.velocities = np.zeros(len(self.arm.joints))

    def set_wrench(self, values: Sequence[float], timeout: float = math.inf) -> None:
        """Sets the wrench that the tool exerts, in its frame (N, Nm).

        :param timeout: time (s) after which it becomes 0, unless it is set again.
        :raises WrongValue: a value is not finite or out of range.
        :raises Refused: the controller is not active, or has stopped at a limit.
        """
        self.check_active()
        self.impedance.set_wrench(values)
        self._wrench_time = timeout if any(values) else math.inf

    def start_overlay(self, goal: SpiralGoal) -> None:
        """Adds a spiral to the reference, in place of the current one, if there is one.

        :raises Refused: the controller is not active, or has stopped at a limit.
        """
        self.check_active()
        self.overlay = Spiral(goal)

    def stop_overlay(self) -> None:
        """Returns to the reference without an overlay motion; does nothing without one."""
        if self.overlay is not None:
            self.overlay.stop()

    def set_limits(self, force: float, torque: float, axes: Sequence[float] = ()) -> None:
        """Sets the limits of the measured force (N) and torque (Nm) under compliant control, 0 for none, and those
        along and about the axes of the tool. Ends a stop.

        :raises WrongValue: a limit is negative or not finite.
        """
        self.limits = self.impedance.limits = checked_limits(force, torque, axes)
        if self.compliant:
            self.stop = None
            self.guard.restart()
            if self._is_held:
                self._is_held = False
                self._restart()

    def set_position_limits(self, force: float, torque: float) -> None:
        """As `set_limits`, under position control: with the weight of a carried object and the inertia of the hand.

        :raises WrongValue: a limit is negative or not finite.
        """
        self.position_limits = checked_limits(force, torque)
        if not self.compliant:
            self.stop = None
            self.guard.restart()
        self._update_often()

    def check_active(self) -> None:
        """Checks that the compliant controller accepts commands.

        :raises Refused: it is not active, or has stopped at a limit.
        """
        if not self.compliant:
            raise Refused(f"controller {self.names[1]} of arm {self.arm.name} is not active")
        self.check_not_stopped()

    def check_not_stopped(self) -> None:
        """Checks that the arm has not stopped at a limit.

        :raises Refused: it has.
        """
        if self.stop is not None:
            raise Refused(f"arm {self.arm.name} has stopped at a {self.stop}; set its limits again to move it")

    @property
    def sensor_age(self) -> float:
        """Age of the measured wrench (s)."""
        return self.arm.silent_steps * self.world.dt

    # -- control ----------------------------------------------------------------------------------------------

    def update(self, dt: float) -> None:
        """Checks the limits, and sets the torques of the compliant controller for the next step."""
        is_due = self._steps % self._period == 0
        self.hand.note(self.world.time)
        if is_due or self.guard.was_exceeded:
            self._check_limits(self._period * dt if is_due else dt)
        if is_due and self.compliant and not self._is_held:
            self._control(self._period * dt)
        self._steps += 1
        if self.compliant and not self._is_held:
            are_new = is_due or not self.arm.is_torque_driven
            self.arm.drive_torques(self.impedance.commanded_torques.tolist()) if are_new else self.arm.keep_torques()

    def _update_often(self) -> None:
        """Updates the controller in each step of the world, if it has something to do there."""
        if self.compliant or any(self.position_limits):
            self.world.motions.add(self)
        else:
            self.world.motions.remove(self)

    def _control(self, dt: float) -> None:
        self._wrench_time -= dt
        if self._wrench_time <= 0.0:
            self._wrench_time = math.inf
            self.impedance.set_wrench((0.0,) * 6)
            log.warning("arm %s: the commanded wrench was not set again in time: it is 0 now", self.arm.name)
        if self.overlay is not None:
            self.impedance.overlay = self.overlay.update(dt)
            if self.overlay.has_ended:
                self.overlay = None
        state = self.force.state(self._state(), dt)
        try:
            if self.force.is_active:
                self.force.update(state, self.arm.measured_wrench(), dt)
            self.impedance.torques(state, dt, self.payload.force)
            self._last = state
        except WrongValue as error:
            self._fail(error)
        if self.stop and self.stop.kind is FailureKind.SENSOR and not self.impedance.is_braking:
            self._is_held = True  # a contact would push a compliant arm on, and nothing measures how hard
            self.hold()

    def _check_limits(self, dt: float) -> None:
        """Stops if the wrench exceeds a limit in two steps in a row, or its sensor cannot be trusted. A single step is
        the impact of rigid bodies, which the filter of a real sensor takes out."""
        if self.stop is not None:
            self.guard.was_exceeded = False
            return
        limits = self.limits if self.compliant else self.position_limits
        balance = _balance(self.impedance, self._last, self.payload, dt) if self.compliant and self._last else None
        age = self.sensor_age + self.world.faults.lag(self.arm.id)
        violation = self.guard.check(self.arm.measured_wrench(), limits, self.world.time, age=age, balance=balance)
        if violation:
            self._stop(violation)

    def _stop(self, violation: Violation) -> None:
        """Brings the arm to rest, and holds it there without wrench and overlay motion."""
        self.overlay = None
        self.force.set_goal(None)
        self.stop = Stop(*violation, self.world.time)
        if self.compliant:
            self.impedance.brake()
        else:
            self.hold()

    def _fail(self, error: WrongValue) -> None:
        """Stops without torques: the law cannot compute them."""
        log.error("arm %s stops: %s", self.arm.name, error)
        self._stop(Violation(NOT_FINITE, 1.0, 0.0))
        self._is_held = True
        self.hold()

    def _state(self) -> ArmState:
        positions, velocities, bias, masses = self.arm.dynamics(self.impedance.needs_masses)
        self._masses = self._masses if masses is None else np.array(masses)
        tool, jacobian = self.kinematics.tool_and_jacobian(positions)
        return ArmState(np.array(positions), np.array(velocities), tool, jacobian, self._masses, np.array(bias))

    def cancel(self) -> None:
        """Switches back to the position controller."""
        self.switch(self.names[0])


def _balance(law: Impedance, state: ArmState, payload: Payload, dt: float) -> Balance:
    """Returns what the law commands, along the axes of the tool, without what the zero of the sensor contains."""
    fx, fy, fz = law.exerted[:3].tolist()
    px, py, pz = payload.measured(state.tool.orientation)
    speed = math.hypot(*state.jacobian[:3].dot(state.velocities).tolist())
    return Balance((fx + px, fy + py, fz + pz), speed, dt)


def _kinematics(world: World, robot: Robot, arm: Arm) -> ArmKinematics:
    """Derives the kinematics of the arm, in the robot's frame, from the loaded model."""
    frames = world.physics.link_poses(robot.body, [joint.index for joint in arm.joints])
    joints = []
    for joint, position, frame in zip(arm.joints, arm.positions(), frames, strict=True):
        lower, upper = max(joint.lower, -2 * np.pi), min(joint.upper, 2 * np.pi)
        joints.append(ChainJoint(position, frame, joint.axis, joint.kind == "prismatic", lower, upper))
    return ArmKinematics(joints, robot.pose(), arm.tool_pose(), arm.rest)
