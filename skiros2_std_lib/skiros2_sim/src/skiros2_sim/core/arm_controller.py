"""What drives the joints of an arm: a position controller, or a compliant one, that can be switched while it moves.

The compliant one is a Cartesian impedance with a posture kept in the nullspace (Khatib, A Unified Approach for Motion
and Force Control of Robot Manipulators, 1987; Albu-Schaeffer et al., Cartesian Impedance Control of Redundant Robots,
2003):

    torques = J' (K dx + D dv) + bias + (I - J' J'+) (k (q0 - q) + d (dq0 - dq))

with the tool's Jacobian J, its way dx to where it is drawn and the velocity dv that it lacks, stiffness K and damping D
in the tool's frame, the bias of gravity and Coriolis forces, and the posture q0 that it is to keep as far as the tool
leaves it free.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.arm_kinematics import ArmKinematics, difference, matrix, measured
from skiros2_sim.core.joint import finite
from skiros2_sim.core.motion import Outcome
from skiros2_sim.core.robot import Robot
from skiros2_sim.core.world import World
from skiros2_std_reasoners.core.geometry import Pose, composed, inverted, rotated

Array = npt.NDArray[np.float64]

#: Along and about the tool's axes (N/m, Nm/rad), where a goal does not say it.
STIFFNESS = (600.0, 600.0, 600.0, 40.0, 40.0, 40.0)
#: The stiffest that is stable with torques that change once a step.
_STIFFEST = (3000.0, 3000.0, 3000.0, 80.0, 80.0, 80.0)
#: The part of the critical damping that the tool gets.
_DAMPING_RATIO = 0.7
#: Keeps the inertia that the tool has finite where the arm is stretched out (1/kg, 1/(kg m2)).
_SINGULAR = 1e-3
#: Likewise of the posture's part that the tool's motion takes.
_SINGULAR_POSTURE = 1e-6 * np.eye(6)
#: The damping changes slowly with the arm's posture: it is found out anew after so many steps.
_DAMPED_ANEW = 8
#: How stiff it is at most, as part of the inertia over the square of a step.
_STABLE = 0.2
#: Of the posture, in the nullspace (Nm/rad).
_POSTURE_STIFFNESS = 10.0
#: It never draws the tool with more than the force of this way (m, rad).
_FARTHEST, _MOST_TURNED = 0.15, 0.5
#: The heaviest thing (N) in the hand that is carried without sagging.
_PAYLOAD = 30.0


class ArmController:
    """The controllers of one arm; there is one of these for each. The position controller is on at first."""

    def __init__(self, world: World, robot: Robot, arm: Arm) -> None:
        self.world = world
        self.robot = robot
        self.arm = arm
        self.kinematics = _kinematics(world, robot, arm)
        self.outcome: Outcome | None = None
        self.compliant = False
        self._stiffness = np.array(STIFFNESS)
        self._drawn_to = np.eye(4)
        self._gains = _Gains(np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(len(arm.joints)))
        self._updates = 0
        self._posture = np.array(arm.rest)
        self._velocities = np.zeros(len(arm.joints))
        self._carried = np.zeros(3)

    @property
    def names(self) -> tuple[str, str]:
        """Of the position controller and the compliant one."""
        return self.arm.spec.position_controller, self.arm.spec.compliant_controller

    @property
    def active(self) -> str:
        """The name of the controller that is on."""
        return self.names[int(self.compliant)]

    @property
    def stiffness(self) -> tuple[float, ...]:
        """Of the compliant controller: N/m along and Nm/rad about the axes of the tool's frame."""
        return tuple(float(value) for value in self._stiffness)

    @stiffness.setter
    def stiffness(self, values: Sequence[float]) -> None:
        self._stiffness = np.array(checked_stiffness(values))
        self._updates = 0

    def switch(self, name: str) -> None:
        """Turns a controller on and the other off; the arm stays where it is, and goes on holding what it holds.

        :raises UnknownName: the arm has no controller of that name.
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
        """The compliant controller holds the weight of what hangs in the hand now; it would give way to it."""
        felt = rotated(self.arm.tool_pose().orientation, self.arm.wrench()[:3])[2]
        # what hangs there pulls down; what the hand is pressed on pushes up, and is let go
        self._carried = np.array([0.0, 0.0, min(max(-felt, 0.0), _PAYLOAD)])

    def hold(self) -> None:
        """The arm stays where it is now."""
        positions = np.array(self.arm.positions())
        if self.compliant:
            self.draw(self.tool_pose(), positions, np.zeros(len(positions)))
        else:
            self.follow(positions, np.zeros(len(positions)))

    def follow(self, positions: Array, velocities: Array) -> None:
        """Where the position controller is to have the joints now."""
        self.arm.drive(positions.tolist(), velocities.tolist())

    def draw(self, tool: Pose, posture: Array, velocities: Array) -> None:
        """Where the compliant controller is to draw the tool to, in the robot's frame, in about that posture of the
        joints, and how fast these are to be there."""
        self._drawn_to, self._posture, self._velocities = matrix(tool), posture, velocities

    def tool_pose(self) -> Pose:
        """Of the tool, in the robot's frame."""
        return composed(inverted(self.robot.pose()), self.arm.tool_pose())

    def update(self, dt: float) -> None:
        """The compliant controller's torques for the next step."""
        if not self.compliant:
            return
        q, dq = np.array(self.arm.positions()), np.array(self.arm.velocities())
        jacobian, tool = self.kinematics.jacobian_and_tool(q)
        # all of it in the tool's frame, in which the stiffness is diagonal
        into = np.zeros((6, 6))
        into[:3, :3] = into[3:, 3:] = tool[:3, :3].T
        in_tool = into @ jacobian
        if self._updates % _DAMPED_ANEW == 0:
            self._gains = _gains(self._stiffness, in_tool, np.array(self.arm.masses()), dt)
        self._updates += 1
        stiffness, damping, posture_damping = self._gains
        too_fast = dq - self._velocities
        way = _shortened(into @ difference(self._drawn_to, tool))
        wrench = stiffness @ way - damping @ (in_tool @ too_fast) + into[:, :3] @ self._carried
        posture = _POSTURE_STIFFNESS * (self._posture - q) - posture_damping * too_fast
        posture -= jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + _SINGULAR_POSTURE, jacobian @ posture)
        self.arm.drive_torques((in_tool.T @ wrench + posture + self.arm.bias()).tolist())

    def cancel(self) -> None:
        """Back to the position controller."""
        self.switch(self.names[0])


def checked_stiffness(values: Sequence[float]) -> list[float]:
    """Six stiffnesses. Raises WrongValue unless they are finite, not negative and no stiffer than what is stable."""
    numbers = finite(values, 6, "stiffness along and about x, y, z")
    for axis, value, most in zip(["x", "y", "z", "rx", "ry", "rz"], numbers, _STIFFEST, strict=True):
        if not 0.0 <= value <= most:
            raise WrongValue(f"stiffness {value} of {axis}: expected 0 to {most:g}")
    return numbers


class _Gains(NamedTuple):
    """Stiffness and damping of the tool, and the damping of the joints' posture, for the arm as it is."""

    stiffness: Array
    damping: Array
    posture_damping: Array


def _gains(stiffness: Array, jacobian: Array, masses: Array, dt: float) -> _Gains:
    """The same part z of the critical damping in all directions, by double diagonalization (Albu-Schaeffer et al.,
    section 3): with Q by which the inertia of the tool is Q Q' and its stiffness Q k Q', k diagonal, the damping is
    Q 2 z sqrt(k) Q'. Where the tool has so little inertia that torques which change once in `dt` could not hold it, it
    is less stiff."""
    mobility = jacobian @ np.linalg.solve(masses, jacobian.T) + _SINGULAR * np.eye(6)
    root = np.linalg.cholesky(mobility)
    modes, vectors = np.linalg.eigh(root.T @ np.diag(stiffness) @ root)
    modes = np.clip(modes, 0.0, _STABLE / dt**2)
    q = np.linalg.solve(root.T, vectors)
    posture = 2 * _DAMPING_RATIO * np.sqrt(_POSTURE_STIFFNESS * np.diag(masses))
    return _Gains(q @ np.diag(modes) @ q.T, q @ np.diag(2 * _DAMPING_RATIO * np.sqrt(modes)) @ q.T, posture)


def _shortened(way: Array) -> Array:
    """A way of at most that length and turn."""
    result = way.copy()
    for part, most in ((slice(0, 3), _FARTHEST), (slice(3, 6), _MOST_TURNED)):
        length = float(np.linalg.norm(way[part]))
        if length > most:
            result[part] *= most / length
    return result


def _kinematics(world: World, robot: Robot, arm: Arm) -> ArmKinematics:
    """The chain of the arm from the robot's frame on, measured on the model as it stands."""
    bullet = world.bullet
    joints = []
    for joint, position in zip(arm.joints, arm.positions(), strict=True):
        state = bullet.getLinkState(robot.body, joint.index, computeForwardKinematics=1)
        axis = bullet.getJointInfo(robot.body, joint.index)[13]
        lower, upper = max(joint.lower, -2 * np.pi), min(joint.upper, 2 * np.pi)
        joints.append((position, Pose(state[4], state[5]), axis, joint.kind == "prismatic", lower, upper))
    return measured(joints, robot.pose(), arm.tool_pose(), arm.rest)
