"""An arm of a robot in the simulated world: motors, tool pose and wrench."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from skiros2_common.core.errors import Refused
from skiros2_motion.core.geometry import Pose, Vector, conjugated, cross, rotated
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.physics import Joint, Part, Physics
from skiros2_sim.core.robot_model import ArmModel
from skiros2_sim.core.wrist_sensor import MountedSensor, SensorModel, Wrench


class Dynamics(NamedTuple):
    """The dynamics of an arm's joints at their current state.

    :param positions: rad or m.
    :param velocities: rad/s or m/s.
    :param bias: torques of gravity, Coriolis and centrifugal forces (Nm, or N).
    :param masses: the mass matrix (kg m2, or kg); None if it was not requested.
    """

    positions: list[float]
    velocities: list[float]
    bias: list[float]
    masses: list[list[float]] | None


class Arm:
    """An arm. It starts at rest in its posture `rest`, held by position motors.

    :param dofs: index of each moving joint of the robot, in the order of the engine's dynamics.
    """

    def __init__(
        self,
        physics: Physics,
        body: int,
        model: ArmModel,
        joints: Mapping[str, Joint],
        links: Mapping[str, int],
        dofs: Sequence[int],
    ) -> None:
        self.id = model.spec.id
        self.name = model.spec.name
        self.spec = model.spec
        self.body = body
        self.joints = tuple(joints[name] for name in model.joints)
        #: The initial posture.
        self.rest = model.rest
        self.mount_link = links[model.mount]
        self.tool_link = links[model.tool]
        self._physics = physics
        self._indices = [joint.index for joint in self.joints]
        #: Of the joints (Nm, or N).
        self.max_efforts = [joint.effort for joint in self.joints]
        self._dofs = list(dofs)
        self._columns = [self._dofs.index(index) for index in self._indices]
        #: The links after the last joint: their contacts produce the wrench.
        self._hand = frozenset(links_after(physics, body, self._indices[-1]))
        #: Whether torques drive the joints, in place of the position motors.
        self.is_torque_driven = False
        #: The torques of the last step.
        self._torques: list[float] = []
        #: The wrench of the last step, once it is read.
        self._wrench: Wrench | None = None
        #: The measured wrench of the last step, once it is read.
        self._measured: Wrench | None = None
        #: The last measured wrench of a silent sensor, and the number of steps since.
        self._last_wrench: Wrench | None = None
        self._silent_steps = 0
        #: Faults of the sensor by kind: each changes the measured wrench.
        self._distortions: dict[str, Callable[[Wrench], Wrench]] = {}
        #: The force/torque sensor at the wrist, if a fixed joint is there.
        self.sensor: MountedSensor | None = None
        for joint, position in zip(self.joints, self.rest, strict=True):
            physics.set_joint(body, joint.index, position)
        spec = model.spec.gripper
        self.gripper: Gripper | None = None
        if spec is not None:
            self.gripper = Gripper(physics, body, spec, [joints[name] for name in model.fingers], self.tool_link)
        self.drive(self.rest)

    # -- state ------------------------------------------------------------------------------------------------

    def positions(self) -> list[float]:
        """Joint positions (rad or m)."""
        return [state.position for state in self._physics.joint_states(self.body, self._indices)]

    def velocities(self) -> list[float]:
        """Joint velocities (rad/s or m/s)."""
        return [state.velocity for state in self._physics.joint_states(self.body, self._indices)]

    def efforts(self) -> list[float]:
        """Motor efforts in the last step (Nm or N)."""
        return [state.effort for state in self._physics.joint_states(self.body, self._indices)]

    def tool_pose(self) -> Pose:
        """Pose of the tool frame in the map."""
        return self._physics.link_pose(Part(self.body, self.tool_link))

    def mount_pose(self) -> Pose:
        """Pose of the first link of the arm in the map."""
        return self._physics.link_pose(Part(self.body, self.mount_link))

    def tool_velocity(self) -> tuple[Vector, Vector]:
        """Linear (m/s) and angular (rad/s) velocity of the tool, in the map."""
        return self._physics.velocity(Part(self.body, self.tool_link))

    def wrench(self) -> Wrench:
        """Returns the external wrench on the hand in the tool frame: force (N), torque (Nm) about its origin.

        Like a wrist sensor without the weight and inertia of the hand: the sum of all contact forces of the last
        step. The forces of two fingers on a held object cancel out, except for its weight.
        """
        if self._wrench is None:
            self._wrench = self._contact_wrench()
        return self._wrench

    def _contact_wrench(self) -> Wrench:
        # In contacts of two bodies the requested one is first; in contacts within the robot the hand may be second.
        pressed = [
            contact.exerted(contact.link in self._hand)
            for contact in self._physics.contacts(self.body)
            if (contact.link in self._hand) != (contact.other_body == self.body and contact.other_link in self._hand)
        ]
        if not pressed:
            return (0.0,) * 6
        tool = self.tool_pose()
        force, torque = [0.0] * 3, [0.0] * 3
        for point, f in pressed:
            turning = cross([at - origin for at, origin in zip(point, tool.position, strict=True)], f)
            force = [a + b for a, b in zip(force, f, strict=True)]
            torque = [a + b for a, b in zip(torque, turning, strict=True)]
        back = conjugated(tool.orientation)
        return (*rotated(back, force), *rotated(back, torque))

    def mount_sensor(self, model: SensorModel, seed: int) -> None:
        """Mounts a force/torque sensor on the fixed joint between the last moving link and the hand, if there is one.

        :param seed: of the noise.
        """
        joints = self._physics.joints(self.body)
        joint = joints[self.tool_link]
        while joint.parent not in (self._indices[-1], -1):
            joint = joints[joint.parent]
        if joint.parent < 0 or joint.moves:
            return
        links = links_after(self._physics, self.body, joint.index)
        random = np.random.default_rng((seed, joint.index))
        part, gripper = Part(self.body, joint.index), self.gripper
        borne = gripper.borne if gripper is not None else lambda: None
        sensor = MountedSensor(self._physics, part, links, model, random, borne)
        if sensor.mass > 0.0:
            self.sensor = sensor

    def after_step(self) -> None:
        """Called by the world after each step."""
        self._wrench = self._measured = None
        if self.sensor is not None:
            self.sensor.after_step()
        if self.gripper is not None:
            self.gripper.after_step()
        if self._last_wrench is not None:
            self._silent_steps += 1

    @property
    def silent_steps(self) -> int:
        """Number of steps since the last measurement of the wrench; 0 for a sensor that works."""
        return self._silent_steps

    def silence_sensor(self, silent: bool) -> None:
        """Makes the sensor at the wrist deliver no measurements, or deliver them again."""
        self._last_wrench = self.measured_wrench() if silent else None
        self._silent_steps = 0

    def distort_sensor(self, kind: str, distortion: Callable[[Wrench], Wrench] | None) -> None:
        """Makes a fault change each measured wrench; None ends it."""
        self._distortions.pop(kind, None)
        if distortion is not None:
            self._distortions[kind] = distortion

    def measured_wrench(self) -> Wrench:
        """Returns the external wrench on the hand that the sensor at the wrist measures, in the tool frame: force (N),
        torque (Nm) about its origin. Without a sensor: `wrench`. Of a silent sensor: the last one. With a fault of the
        sensor: any numbers, also some that are not finite."""
        if self._last_wrench is not None:
            return self._last_wrench
        if self._measured is None:
            self._measured = self.wrench() if self.sensor is None else self.sensor.wrench(self.tool_pose())
        measured = self._measured
        for distortion in self._distortions.values():
            measured = distortion(measured)
        return measured

    def zero_sensor(self) -> None:
        """Makes the current measured wrench the zero of the following ones.

        :raises Refused: there is no sensor.
        """
        if self.sensor is None:
            raise Refused(f"arm {self.name} has no force/torque sensor: no fixed joint is before its hand")
        self.sensor.zero()
        self._measured = None

    # -- motors -----------------------------------------------------------------------------------------------

    def drive(self, positions: Sequence[float], velocities: Sequence[float] | None = None) -> None:
        """Sets target positions and velocities of the position motors, until the next call. Efforts are limited by the
        joints.

        :raises WrongValue: these are not finite numbers, one per joint.
        """
        count = len(self.joints)
        wanted = finite(positions, count, f"{self.id}: positions")
        speeds = [0.0] * count if velocities is None else finite(velocities, count, f"{self.id}: velocities")
        self.is_torque_driven = False
        self._physics.drive_positions(self.body, self._indices, wanted, speeds, self.max_efforts)

    def drive_torques(self, torques: Sequence[float]) -> None:
        """Sets the joint torques (Nm, or N) for the next step, limited by the joints, and releases the position motors.

        :raises WrongValue: these are not finite numbers, one per joint.
        """
        wanted = finite(torques, len(self.joints), f"{self.id}: torques")
        if not self.is_torque_driven:
            self.is_torque_driven = True
            none = [0.0] * len(self.joints)
            self._physics.drive_velocities(self.body, self._indices, none, none)
        self._torques = [min(max(t, -e), e) for t, e in zip(wanted, self.max_efforts, strict=True)]
        self.keep_torques()

    def keep_torques(self) -> None:
        """Sets the last joint torques for the next step too: the engine forgets them after each one."""
        self._physics.drive_torques(self.body, self._indices, self._torques)

    def dynamics(self, with_masses: bool) -> Dynamics:
        """Returns the current state of the joints with the bias, and the mass matrix, of the arm's dynamics."""
        states = self._physics.joint_states(self.body, self._dofs)
        q, dq = [state.position for state in states], [state.velocity for state in states]
        bias = self._physics.bias(self.body, q, dq)
        masses = None
        if with_masses:
            every = self._physics.mass_matrix(self.body, q)
            masses = [[every[row][column] for column in self._columns] for row in self._columns]
        columns = self._columns
        return Dynamics([q[i] for i in columns], [dq[i] for i in columns], [bias[i] for i in columns], masses)


def links_after(physics: Physics, body: int, link: int) -> list[int]:
    """Returns a link and all its descendants."""
    found = {link}
    for joint in physics.joints(body):
        if joint.parent in found:
            found.add(joint.index)
    return sorted(found)
