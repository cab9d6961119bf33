"""A gripper in the simulated world, and its motions, as a driver of control_msgs/GripperCommand makes them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, Vector, angle_between, rotated
from skiros2_motion.core.motion import Outcome, State
from skiros2_sim.core.physics import Joint, Part, Physics
from skiros2_sim.core.scene_spec import GripperSpec

#: Friction of the rubber pads; PyBullet multiplies the values of both contact partners.
FRICTION = 1.2
_SPINNING = 0.02
_SPEED = 0.1  # m/s, of a finger
_COUPLING = 50.0  # N, between the fingers
#: Anchored contacts keep the direction of their first normal: they are made again after a turn of this size (rad),
#: which is looked for every so many steps. Without it, fingers stick to an object after half a turn.
_TURN, _STEPS = 0.05, 10
#: Default effort of a finger (N).
_EFFORT = 20.0


class Gripper:
    """A gripper. It starts open.

    :param fingers: their joints, prismatic with 0 when closed; empty for a model without fingers.
    :param tool_link: index of the link between the fingertips.
    """

    def __init__(
        self, physics: Physics, body: int, spec: GripperSpec, fingers: Sequence[Joint], tool_link: int
    ) -> None:
        self.id = spec.id
        self.name = spec.name
        self.spec = spec
        self.body = body
        self.joints = tuple(fingers)
        self.tool_link = tool_link
        self.min_width = sum(joint.lower for joint in fingers)
        self.max_width = sum(joint.upper for joint in fingers)
        self._physics = physics
        self._indices = [joint.index for joint in fingers]
        for joint in fingers:
            physics.set_joint(body, joint.index, joint.upper)
        self.set_friction(1.0)
        self._coupling: int | None = None
        if len(fingers) == 2:  # so that a gripped object is centred
            self._coupling = physics.couple(body, self._indices[0], self._indices[1], _COUPLING)
        self.drive(self.max_width)
        self._steps = 0
        self._direction = self.tool_pose().orientation

    def width(self) -> float:
        """Distance between the fingers (m)."""
        return sum((state.position for state in self._physics.joint_states(self.body, self._indices)), 0.0)

    def force(self) -> float:
        """Mean motor force of the fingers in the last step (N)."""
        if not self.joints:
            return 0.0
        pressed = [abs(state.effort) for state in self._physics.joint_states(self.body, self._indices)]
        return sum(pressed) / len(pressed)

    def borne(self) -> tuple[Vector, Vector] | None:
        """Returns a point, and the force on the hand along its fingers that their coupling has borne in the last step
        (N), both in the map; None without a coupling."""
        if self._coupling is None:
            return None
        x, y, z = self.joints[0].axis
        pose = self._physics.link_pose(Part(self.body, self._indices[0]))
        force = -self._physics.coupling_force(self._coupling)
        return pose.position, rotated(pose.orientation, (force * x, force * y, force * z))

    def tool_pose(self) -> Pose:
        """Pose of the frame between the fingertips, in the map."""
        return self._physics.link_pose(Part(self.body, self.tool_link))

    def drive(self, width: float, effort: float = 0.0) -> None:
        """Sets the target width (m) and maximum force (N) of the fingers, until the next call.

        :param effort: 0 for the maximum of the fingers.
        :raises WrongValue: a number is not finite, or the effort is negative.
        """
        if not (math.isfinite(width) and math.isfinite(effort) and effort >= 0):
            raise WrongValue(f"{self.id}: expected a finite width and an effort of 0 or more, got {width}, {effort}")
        for joint in self.joints:
            most = joint.effort or _EFFORT
            position = min(max(width / len(self.joints), joint.lower), joint.upper)
            speed = min(joint.velocity or _SPEED, _SPEED)
            self._physics.drive_to(self.body, joint.index, position, min(effort or most, most), speed)

    def set_friction(self, part: float) -> None:
        """Scales the friction of the fingers, 0 to 1. Without anchors a held object creeps under a load."""
        for index in self._indices:
            self._physics.set_surface(
                self.body, index, FRICTION * part, spinning=_SPINNING * part, anchored=part == 1.0
            )
        self._renew_contacts()

    def after_step(self) -> None:
        """Called by its arm after each step."""
        self._steps += 1
        if self.joints and self._steps % _STEPS == 0:
            direction = self.tool_pose().orientation
            if angle_between(self._direction, direction) > _TURN:
                self._direction = direction
                self._renew_contacts()

    def _renew_contacts(self) -> None:
        for index in self._indices:
            self._physics.forget_contacts(self.body, index)


#: Tolerance of the width (m).
_NEAR = 0.001
#: The fingers are at rest if they move less than this (m) within that time (s); timeout of a motion (s).
_STANDS, _STOOD, _MAX_DURATION = 0.0002, 0.15, 10.0


class GripperMotion:
    """A motion to a finger distance with a maximum force. It succeeds at the target, or when an object stops the
    fingers. Afterwards the fingers keep pressing: they hold the object, and close further if it slips out."""

    def __init__(self, gripper: Gripper, width: float, effort: float = 0.0) -> None:
        """Starts the motion: `width` in m, `effort` in N; 0 for the maximum."""
        self.outcome: Outcome | None = None
        self.stalled = False
        self.reached_goal = False
        self._gripper = gripper
        self._width = width
        self._stood_since = self._spent = 0.0
        self._stood_at = gripper.width()
        rejection = _rejection(gripper, width, effort)
        if rejection:
            self.outcome = Outcome(State.REJECTED, rejection)
            return
        gripper.drive(width, effort)

    @property
    def width(self) -> float:
        """Current distance between the fingers (m)."""
        return self._gripper.width()

    @property
    def effort(self) -> float:
        """Current motor force (N)."""
        return self._gripper.force()

    def update(self, dt: float) -> None:
        """Advances by `dt` seconds."""
        if self.outcome is not None:
            return
        self._spent += dt
        width = self.width
        if abs(width - self._stood_at) > _STANDS:
            self._stood_at, self._stood_since = width, self._spent
        if self._spent - self._stood_since >= _STOOD:
            self.reached_goal = abs(width - self._width) <= _NEAR
            self.stalled = not self.reached_goal
            what = f"an object holds the fingers {width:.4f} m apart" if self.stalled else ""
            self.outcome = Outcome(State.SUCCEEDED, what)
        elif self._spent > _MAX_DURATION:
            self.outcome = Outcome(State.ABORTED, f"the fingers do not come to rest; they are {width:.4f} m apart")

    def cancel(self) -> None:
        """Stops the fingers; a gripper that holds an object keeps holding it."""
        if self.outcome is None:
            if abs(self.width - self._stood_at) > _STANDS or self.effort == 0.0:
                self._gripper.drive(self.width)
            self.outcome = Outcome(State.PREEMPTED, "cancelled")


def _rejection(gripper: Gripper, width: float, effort: float) -> str:
    """Returns why a command is invalid; "" if it is valid."""
    if not gripper.joints:
        return f"gripper {gripper.name} has no fingers in its model"
    if not math.isfinite(width) or not gripper.min_width - _NEAR <= width <= gripper.max_width + _NEAR:
        return f"width {width} m: gripper {gripper.name} opens from {gripper.min_width:g} to {gripper.max_width:g} m"
    if not math.isfinite(effort) or effort < 0.0:
        return f"effort {effort} N: expected a number, 0 or more"
    return ""
