"""A gripper in the simulated world: two fingers with one motor each."""

from __future__ import annotations

import math
from collections.abc import Sequence

from skiros2_common.core.errors import WrongValue
from skiros2_sim.core.bullet import Bullet
from skiros2_sim.core.joint import Joint
from skiros2_sim.core.scene_spec import GripperSpec
from skiros2_std_reasoners.core.geometry import Pose

#: Friction of the rubber pads; PyBullet multiplies the values of both contact partners.
FRICTION = 1.2
_SPINNING = 0.02
_SPEED = 0.1  # m/s, of a finger
#: Default effort of a finger (N).
_EFFORT = 20.0


class Gripper:
    """A gripper. It starts open.

    :param fingers: their joints, prismatic with 0 when closed; empty for a model without fingers.
    :param tool_link: index of the link between the fingertips.
    """

    def __init__(self, bullet: Bullet, body: int, spec: GripperSpec, fingers: Sequence[Joint], tool_link: int) -> None:
        self.id = spec.id
        self.name = spec.name
        self.spec = spec
        self.body = body
        self.joints = tuple(fingers)
        self.tool_link = tool_link
        self.min_width = sum(joint.lower for joint in fingers)
        self.max_width = sum(joint.upper for joint in fingers)
        self._bullet = bullet
        self._indices = [joint.index for joint in fingers]
        for joint in fingers:
            bullet.resetJointState(body, joint.index, joint.upper)
        self.set_friction(1.0)
        if len(fingers) == 2:
            self._couple(*self._indices)
        self.drive(self.max_width)

    def width(self) -> float:
        """Distance between the fingers (m)."""
        states = self._bullet.getJointStates(self.body, self._indices) if self.joints else ()
        return sum((float(state[0]) for state in states), 0.0)

    def force(self) -> float:
        """Mean motor force of the fingers in the last step (N)."""
        if not self.joints:
            return 0.0
        pressed = [abs(float(state[3])) for state in self._bullet.getJointStates(self.body, self._indices)]
        return sum(pressed) / len(pressed)

    def tool_pose(self) -> Pose:
        """Pose of the frame between the fingertips, in the map."""
        state = self._bullet.getLinkState(self.body, self.tool_link, computeForwardKinematics=1)
        return Pose(state[4], state[5])

    def drive(self, width: float, effort: float = 0.0) -> None:
        """Sets the target width (m) and maximum force (N) of the fingers, until the next call.

        :param effort: 0 for the maximum of the fingers.
        :raises WrongValue: a number is not finite, or the effort is negative.
        """
        if not (math.isfinite(width) and math.isfinite(effort) and effort >= 0):
            raise WrongValue(f"{self.id}: expected a finite width and an effort of 0 or more, got {width}, {effort}")
        for joint in self.joints:
            most = joint.effort or _EFFORT
            self._bullet.setJointMotorControl2(
                self.body,
                joint.index,
                self._bullet.POSITION_CONTROL,
                targetPosition=min(max(width / len(self.joints), joint.lower), joint.upper),
                force=min(effort or most, most),
                maxVelocity=min(joint.velocity or _SPEED, _SPEED),
            )

    def set_friction(self, part: float) -> None:
        """Scales the friction of the fingers, 0 to 1."""
        for index in self._indices:
            self._bullet.changeDynamics(
                self.body,
                index,
                lateralFriction=FRICTION * part,
                spinningFriction=_SPINNING * part,
                frictionAnchor=False,
            )

    def _couple(self, one: int, other: int) -> None:
        """Couples the fingers, so that a gripped object is centred."""
        gear = self._bullet.createConstraint(
            self.body, one, self.body, other, self._bullet.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        self._bullet.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)
