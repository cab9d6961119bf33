"""An arm of a robot in the simulated world: motors, tool pose and wrench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skiros2_motion.core.geometry import Pose, Vector, conjugated, rotated
from skiros2_motion.core.numbers import finite
from skiros2_sim.core.bullet import Bullet, Joint
from skiros2_sim.core.gripper import Gripper
from skiros2_sim.core.robot_model import ArmModel
from skiros2_sim.core.wrist_sensor import MountedSensor, SensorModel

Wrench = tuple[float, float, float, float, float, float]


class Arm:
    """An arm. It starts at rest in its posture `rest`, held by position motors.

    :param dofs: index of each moving joint of the robot, in the order of PyBullet's dynamics.
    """

    def __init__(
        self,
        bullet: Bullet,
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
        self._bullet = bullet
        self._indices = [joint.index for joint in self.joints]
        self._efforts = [joint.effort for joint in self.joints]
        self._dofs = list(dofs)
        self._columns = [self._dofs.index(index) for index in self._indices]
        #: The links after the last joint: their contacts produce the wrench.
        self._hand = frozenset(_links_after(bullet, body, self._indices[-1]))
        self._is_torque_driven = False
        #: The wrench of the last step, once it is read.
        self._wrench: Wrench | None = None
        #: The last measured wrench of a silent sensor, and the number of steps since.
        self._last_wrench: Wrench | None = None
        self._silent_steps = 0
        #: The force/torque sensor at the wrist, if a fixed joint is there.
        self.sensor: MountedSensor | None = None
        for joint, position in zip(self.joints, self.rest, strict=True):
            bullet.resetJointState(body, joint.index, position)
        spec = model.spec.gripper
        self.gripper: Gripper | None = None
        if spec is not None:
            self.gripper = Gripper(bullet, body, spec, [joints[name] for name in model.fingers], self.tool_link)
        self.drive(self.rest)

    # -- state ------------------------------------------------------------------------------------------------

    def positions(self) -> list[float]:
        """Joint positions (rad or m)."""
        return [state[0] for state in self._bullet.getJointStates(self.body, self._indices)]

    def velocities(self) -> list[float]:
        """Joint velocities (rad/s or m/s)."""
        return [state[1] for state in self._bullet.getJointStates(self.body, self._indices)]

    def efforts(self) -> list[float]:
        """Motor efforts in the last step (Nm or N)."""
        return [state[3] for state in self._bullet.getJointStates(self.body, self._indices)]

    def tool_pose(self) -> Pose:
        """Pose of the tool frame in the map."""
        return self._link_pose(self.tool_link)

    def mount_pose(self) -> Pose:
        """Pose of the first link of the arm in the map."""
        return self._link_pose(self.mount_link)

    def tool_velocity(self) -> tuple[Vector, Vector]:
        """Linear (m/s) and angular (rad/s) velocity of the tool, in the map."""
        state = self._bullet.getLinkState(self.body, self.tool_link, computeLinkVelocity=1, computeForwardKinematics=1)
        return state[6], state[7]

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
            _exerted(contact, contact[3] in self._hand)
            for contact in self._bullet.getContactPoints(bodyA=self.body)
            if (contact[3] in self._hand) != (contact[2] == self.body and contact[4] in self._hand)
        ]
        if not pressed:
            return (0.0,) * 6
        tool = self.tool_pose()
        force, torque = [0.0] * 3, [0.0] * 3
        for point, f in pressed:
            x, y, z = (at - origin for at, origin in zip(point, tool.position, strict=True))
            turning = (y * f[2] - z * f[1], z * f[0] - x * f[2], x * f[1] - y * f[0])
            force = [a + b for a, b in zip(force, f, strict=True)]
            torque = [a + b for a, b in zip(torque, turning, strict=True)]
        back = conjugated(tool.orientation)
        return (*rotated(back, force), *rotated(back, torque))

    def mount_sensor(self, model: SensorModel, seed: int) -> None:
        """Mounts a force/torque sensor on the fixed joint between the last moving link and the hand, if there is one.

        :param seed: of the noise.
        """
        link, parent = self.tool_link, self._parent(self.tool_link)
        while parent not in (self._indices[-1], -1):
            link, parent = parent, self._parent(parent)
        if parent < 0 or Joint.of(self._bullet.getJointInfo(self.body, link)).moves:
            return
        links = _links_after(self._bullet, self.body, link)
        sensor = MountedSensor(self._bullet, self.body, link, links, model, np.random.default_rng((seed, link)))
        if sensor.mass > 0.0:
            self.sensor = sensor

    def after_step(self) -> None:
        """Called by the world after each step."""
        self._wrench = None
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

    def measured_wrench(self) -> Wrench:
        """Returns the external wrench on the hand that the sensor at the wrist measures, in the tool frame: force (N),
        torque (Nm) about its origin. Without a sensor: `wrench`. Of a silent sensor: the last one."""
        if self._last_wrench is not None:
            return self._last_wrench
        if self.sensor is None:
            return self.wrench()
        fx, fy, fz, tx, ty, tz = self.sensor.wrench(self.tool_pose())
        return fx, fy, fz, tx, ty, tz

    def _parent(self, link: int) -> int:
        parent: int = self._bullet.getJointInfo(self.body, link)[16]
        return parent

    # -- motors -----------------------------------------------------------------------------------------------

    def drive(self, positions: Sequence[float], velocities: Sequence[float] | None = None) -> None:
        """Sets target positions and velocities of the position motors, until the next call. Efforts are limited by the
        joints.

        :raises WrongValue: these are not finite numbers, one per joint.
        """
        count = len(self.joints)
        wanted = finite(positions, count, f"{self.id}: positions")
        speeds = [0.0] * count if velocities is None else finite(velocities, count, f"{self.id}: velocities")
        self._is_torque_driven = False
        self._bullet.setJointMotorControlArray(
            self.body,
            self._indices,
            self._bullet.POSITION_CONTROL,
            targetPositions=wanted,
            targetVelocities=speeds,
            forces=self._efforts,
        )

    def drive_torques(self, torques: Sequence[float]) -> None:
        """Sets the joint torques (Nm, or N) for the next step, limited by the joints, and releases the position motors.

        :raises WrongValue: these are not finite numbers, one per joint.
        """
        wanted = finite(torques, len(self.joints), f"{self.id}: torques")
        if not self._is_torque_driven:
            self._is_torque_driven = True
            self._bullet.setJointMotorControlArray(
                self.body, self._indices, self._bullet.VELOCITY_CONTROL, forces=[0.0] * len(self.joints)
            )
        self._bullet.setJointMotorControlArray(
            self.body,
            self._indices,
            self._bullet.TORQUE_CONTROL,
            forces=[min(max(t, -e), e) for t, e in zip(wanted, self._efforts, strict=True)],
        )

    def masses(self) -> list[list[float]]:
        """Mass matrix at the current joint positions (kg m2, or kg)."""
        positions = [state[0] for state in self._bullet.getJointStates(self.body, self._dofs)]
        masses = self._bullet.calculateMassMatrix(self.body, positions)
        return [[masses[row][column] for column in self._columns] for row in self._columns]

    def bias(self) -> list[float]:
        """Torques of gravity, Coriolis and centrifugal forces at the current state (Nm, or N)."""
        states = self._bullet.getJointStates(self.body, self._dofs)
        q, dq = [state[0] for state in states], [state[1] for state in states]
        bias = self._bullet.calculateInverseDynamics(self.body, q, dq, [0.0] * len(self._dofs))
        return [bias[column] for column in self._columns]

    def _link_pose(self, index: int) -> Pose:
        state = self._bullet.getLinkState(self.body, index, computeForwardKinematics=1)
        return Pose(state[4], state[5])


def _exerted(contact: Sequence[Any], on_first: bool) -> tuple[Vector, Vector]:
    """Returns the position of a PyBullet contact, and its force on the first or the second body."""
    normal, pushed = contact[7], contact[9]
    one, along_one, other, along_other = contact[10:14]
    x, y, z = (pushed * normal[i] + one * along_one[i] + other * along_other[i] for i in range(3))
    return (contact[5], (x, y, z)) if on_first else (contact[6], (-x, -y, -z))


def _links_after(bullet: Bullet, body: int, link: int) -> list[int]:
    """Returns a link and all its descendants."""
    found = {link}
    for index in range(bullet.getNumJoints(body)):  # parents have smaller indices
        if bullet.getJointInfo(body, index)[16] in found:
            found.add(index)
    return sorted(found)
