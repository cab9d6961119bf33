"""Controllers of an arm's joints: a position controller and a compliant one, which can be switched during motion.

The compliant one is a Cartesian impedance with a posture kept in the nullspace (Khatib, A Unified Approach for Motion
and Force Control of Robot Manipulators, 1987; Albu-Schaeffer et al., Cartesian Impedance Control of Redundant Robots,
2003):

    torques = J' (K dx + D dv) + bias + (I - J' J'+) (k (q0 - q) + d (dq0 - dq))

with the tool's Jacobian J, the offset dx to its target, the velocity error dv, stiffness K and damping D in the tool
frame, the bias of gravity and Coriolis forces, and the posture q0, which is kept in the nullspace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.arm_kinematics import ArmKinematics, ChainJoint, difference
from skiros2_sim.core.bullet import finite
from skiros2_sim.core.motion import Outcome
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, composed, inverted, rotated

Array = npt.NDArray[np.float64]

#: Default stiffness along and about the tool's axes (N/m, Nm/rad).
STIFFNESS = (600.0, 600.0, 600.0, 40.0, 40.0, 40.0)
#: Maximum stiffness that is stable with torques that change once per step.
_MAX_STIFFNESS = (3000.0, 3000.0, 3000.0, 80.0, 80.0, 80.0)
#: Damping ratio of the tool.
_DAMPING_RATIO = 0.7
#: Regularisation of the tool's inertia at singularities (1/kg, 1/(kg m2)).
_SINGULAR = 1e-3
#: Regularisation of the nullspace projection.
_SINGULAR_POSTURE = 1e-6 * np.eye(6)
#: Number of steps between updates of the damping, which changes slowly with the posture.
_DAMPING_PERIOD = 8
#: Maximum stiffness as a fraction of the inertia over the square of the step length.
_STABLE = 0.2
#: Stiffness of the posture in the nullspace (Nm/rad).
_POSTURE_STIFFNESS = 10.0
#: Maximum offset from the target that produces a force (m, rad).
_MAX_DISTANCE, _MAX_TURN = 0.15, 0.5
#: Maximum weight (N) of a carried object that is compensated.
_PAYLOAD = 30.0


class ArmController:
    """The controllers of one arm; one instance per arm. The position controller is active first."""

    def __init__(self, world: World, robot: Robot, arm: Arm) -> None:
        self.world = world
        self.robot = robot
        self.arm = arm
        self.kinematics = _kinematics(world, robot, arm)
        self.outcome: Outcome | None = None
        self.compliant = False
        self._stiffness = np.array(STIFFNESS)
        self._drawn_to = IDENTITY
        self._gains = _Gains(np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(len(arm.joints)))
        self._updates = 0
        self._posture = np.array(arm.rest)
        self._velocities = np.zeros(len(arm.joints))
        self._carried = np.zeros(3)

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
        return tuple(float(value) for value in self._stiffness)

    @stiffness.setter
    def stiffness(self, values: Sequence[float]) -> None:
        self._stiffness = np.array(checked_stiffness(values))
        self._updates = 0

    def switch(self, name: str) -> None:
        """Activates a controller and deactivates the other. The arm keeps its position and its load.

        :raises UnknownName: the arm has no such controller.
        """
        if name not in self.names:
            raise UnknownName(f"arm {self.arm.name} has no controller {name!r}; it has {' and '.join(self.names)}")
        if name == self.active:
            return
        self.compliant = not self.compliant
        self._updates = 0
        self.hold()
        if self.compliant:
            self.carry()
            self.world.motions.add(self)
        else:
            self.world.motions.remove(self)

    def carry(self) -> None:
        """Makes the compliant controller compensate the weight of the object in the hand."""
        felt = rotated(self.arm.tool_pose().orientation, self.arm.wrench()[:3])[2]
        # a suspended object pulls down; a contact from below pushes up and is not compensated
        self._carried = np.array([0.0, 0.0, min(max(-felt, 0.0), _PAYLOAD)])

    def hold(self) -> None:
        """Holds the current position."""
        positions = np.array(self.arm.positions())
        if self.compliant:
            self.draw(self.tool_pose(), positions, np.zeros(len(positions)))
        else:
            self.follow(positions, np.zeros(len(positions)))

    def follow(self, positions: Array, velocities: Array) -> None:
        """Sets the targets of the position controller."""
        self.arm.drive(positions.tolist(), velocities.tolist())

    def draw(self, tool: Pose, posture: Array, velocities: Array) -> None:
        """Sets the targets of the compliant controller: tool pose in the robot's frame, posture of the joints (in the
        nullspace) and joint velocities."""
        self._drawn_to, self._posture, self._velocities = tool, posture, velocities

    def tool_pose(self) -> Pose:
        """Pose of the tool in the robot's frame."""
        return composed(inverted(self.robot.pose()), self.arm.tool_pose())

    def update(self, dt: float) -> None:
        """Sets the torques of the compliant controller for the next step."""
        if not self.compliant:
            return
        q, dq = np.array(self.arm.positions()), np.array(self.arm.velocities())
        tool = self.kinematics.forward(q)
        jacobian = self.kinematics.jacobian(q)
        # computed in the tool frame, where the stiffness is diagonal
        into = np.zeros((6, 6))
        into[:3, :3] = into[3:, 3:] = Rotation.from_quat(tool.orientation).inv().as_matrix()
        in_tool = into @ jacobian
        if self._updates % _DAMPING_PERIOD == 0:
            self._gains = _gains(self._stiffness, in_tool, np.array(self.arm.masses()), dt)
        self._updates += 1
        stiffness, damping, posture_damping = self._gains
        too_fast = dq - self._velocities
        way = _clipped(into @ difference(self._drawn_to, tool))
        wrench = stiffness @ way - damping @ (in_tool @ too_fast) + into[:, :3] @ self._carried
        posture = _POSTURE_STIFFNESS * (self._posture - q) - posture_damping * too_fast
        posture -= jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + _SINGULAR_POSTURE, jacobian @ posture)
        self.arm.drive_torques((in_tool.T @ wrench + posture + self.arm.bias()).tolist())

    def cancel(self) -> None:
        """Switches back to the position controller."""
        self.switch(self.names[0])


def checked_stiffness(values: Sequence[float]) -> list[float]:
    """Checks six stiffnesses.

    :raises WrongValue: one is negative, not finite, or above the maximum for stability.
    """
    numbers = finite(values, 6, "stiffness along and about x, y, z")
    for axis, value, most in zip(["x", "y", "z", "rx", "ry", "rz"], numbers, _MAX_STIFFNESS, strict=True):
        if not 0.0 <= value <= most:
            raise WrongValue(f"stiffness {value} of {axis}: expected 0 to {most:g}")
    return numbers


class _Gains(NamedTuple):
    """Stiffness and damping of the tool, and damping of the posture, in the current state."""

    stiffness: Array
    damping: Array
    posture_damping: Array


def _gains(stiffness: Array, jacobian: Array, masses: Array, dt: float) -> _Gains:
    """Computes the damping with the same ratio z in all directions by double diagonalization (Albu-Schaeffer et al.,
    section 3): for Q with inertia Q Q' and stiffness Q k Q' of the tool, k diagonal, the damping is Q 2 z sqrt(k) Q'.
    The stiffness is reduced where the inertia is too low for torques that change once per `dt`."""
    mobility = jacobian @ np.linalg.solve(masses, jacobian.T) + _SINGULAR * np.eye(6)
    root = np.linalg.cholesky(mobility)
    modes, vectors = np.linalg.eigh(root.T @ np.diag(stiffness) @ root)
    modes = np.clip(modes, 0.0, _STABLE / dt**2)
    q = np.linalg.solve(root.T, vectors)
    posture = 2 * _DAMPING_RATIO * np.sqrt(_POSTURE_STIFFNESS * np.diag(masses))
    return _Gains(q @ np.diag(modes) @ q.T, q @ np.diag(2 * _DAMPING_RATIO * np.sqrt(modes)) @ q.T, posture)


def _clipped(way: Array) -> Array:
    """Limits an offset in length and rotation."""
    result = way.copy()
    for part, most in ((slice(0, 3), _MAX_DISTANCE), (slice(3, 6), _MAX_TURN)):
        length = float(np.linalg.norm(way[part]))
        if length > most:
            result[part] *= most / length
    return result


def _kinematics(world: World, robot: Robot, arm: Arm) -> ArmKinematics:
    """Derives the kinematics of the arm, in the robot's frame, from the loaded model."""
    bullet = world.bullet
    joints = []
    for joint, position in zip(arm.joints, arm.positions(), strict=True):
        state = bullet.getLinkState(robot.body, joint.index, computeForwardKinematics=1)
        axis = bullet.getJointInfo(robot.body, joint.index)[13]
        lower, upper = max(joint.lower, -2 * np.pi), min(joint.upper, 2 * np.pi)
        joints.append(
            ChainJoint(position, Pose(state[4], state[5]), axis, joint.kind == "prismatic", lower, upper)
        )
    return ArmKinematics(joints, robot.pose(), arm.tool_pose(), arm.rest)
