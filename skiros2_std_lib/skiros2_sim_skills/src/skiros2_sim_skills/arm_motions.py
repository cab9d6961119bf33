"""Primitives for the arm with control_msgs/FollowJointTrajectory and skiros2_sim_msgs/CartesianMotion."""

from __future__ import annotations

import rospy
from actionlib_msgs.msg import GoalStatus
from genpy import Message
from trajectory_msgs.msg import JointTrajectoryPoint

from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal, FollowJointTrajectoryResult
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_demo_skills.motions import TuckArm
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector
from skiros2_sim_msgs.msg import (
    CartesianMotionAction,
    CartesianMotionFeedback,
    CartesianMotionGoal,
    CartesianMotionResult,
)
from skiros2_sim_skills.base_motion import stamped
from skiros2_sim_skills.motions import LiftTool, MoveArmJoints, MoveToolToContainer, MoveToolToObject
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.places import Box, above, box_of, direction_between, grasp_of, release_of
from skiros2_std_reasoners.core.scene_poses import parent_of, pose_in_scene, size_of
from skiros2_std_skills.core.devices import TOOL_FRAME, name_of, opening, posture
from skiros2_std_skills.core.driver_names import CARTESIAN, TRAJECTORY, part_name, robot_name
from skiros2_std_skills.drivers import DriverAction

#: Distance below the expected contact to which a motion until contact may continue (m).
_GIVE = 0.025

#: Meaning of the error codes of control_msgs/FollowJointTrajectory.
JOINT_CODES = {
    FollowJointTrajectoryResult.INVALID_GOAL: "the arm rejects the posture",
    FollowJointTrajectoryResult.INVALID_JOINTS: "the joints are not those of the arm",
    FollowJointTrajectoryResult.OLD_HEADER_TIMESTAMP: "the goal is too late",
    FollowJointTrajectoryResult.PATH_TOLERANCE_VIOLATED: "the arm was blocked on its path",
    FollowJointTrajectoryResult.GOAL_TOLERANCE_VIOLATED: "the arm did not reach the posture",
}
_CARTESIAN_CODES = {
    CartesianMotionGoal.INVALID_GOAL: "the arm rejects the goal",
    CartesianMotionGoal.UNREACHABLE: "out of reach of the arm",
    CartesianMotionGoal.FORCE_LIMIT: "the tool has hit something",
    CartesianMotionGoal.NO_CONTACT: "there is no surface to put it down on",
    CartesianMotionGoal.TIMED_OUT: "the motion timed out",
    CartesianMotionGoal.BLOCKED: "the arm is blocked",
    CartesianMotionGoal.PREEMPTED: "preempted by another motion",
}


class move_arm_joints(DriverAction):
    """Sends a posture as a trajectory of one point."""

    def createDescription(self) -> None:
        self.setDescription(MoveArmJoints(), self.__class__.__name__)

    def address(self) -> tuple[str, type]:
        return name_of(TRAJECTORY, self.element("Robot"), self.element("Arm")), FollowJointTrajectoryAction

    def doing(self) -> str:
        return f"Moving the arm to posture {self.value('Posture')!r}"

    def buildGoal(self) -> FollowJointTrajectoryGoal:
        duration = self.value("Duration")
        if not 0.0 < duration < 1e6:
            raise WrongValue(f"duration {duration} s: expected more than 0")
        joints = posture(self.element("Arm"), self.value("Posture"))
        goal = FollowJointTrajectoryGoal()
        goal.trajectory.joint_names = list(joints)
        goal.trajectory.points = [
            JointTrajectoryPoint(positions=list(joints.values()), time_from_start=rospy.Duration.from_sec(duration))
        ]
        return goal

    def onDone(self, status: int, msg: FollowJointTrajectoryResult) -> State:
        if status == GoalStatus.SUCCEEDED:
            return self.success(f"{self.doing()}: there")
        return self.failed(format_reason(JOINT_CODES, msg, self.status_text()), status)


class tuck_arm(move_arm_joints):
    """Moves the arm to its posture for driving and looking."""

    def createDescription(self) -> None:
        self.setDescription(TuckArm(), self.__class__.__name__)
        self.addParam("Posture", "home", ParamTypes.Optional, description="Name in skiros:Postures of the arm")
        self.addParam("Duration", 2.5, ParamTypes.Optional, description="Duration of the motion", unit="s", minimum=0.1)


class _ToolMotion(DriverAction):
    """Base of the straight motions of the tool."""

    def address(self) -> tuple[str, type]:
        return name_of(CARTESIAN, self.element("Robot"), self.element("Arm")), CartesianMotionAction

    def ahead(self, target: Pose) -> Vector:
        """Returns the direction from the arm to a pose."""
        return direction_between(pose_in_scene(self.wmi, self.element("Arm"))[1], target)

    def onFeedback(self, msg: CartesianMotionFeedback) -> State:
        return self.step(f"{self.doing()}: {msg.distance:.2f} m to go")

    def onDone(self, status: int, msg: CartesianMotionResult) -> State:
        if status == GoalStatus.SUCCEEDED:
            return self.success(f"{self.doing()}: done")
        is_limit = getattr(msg, "error_code", 0) == CartesianMotionGoal.FORCE_LIMIT
        kind = FailureKind.LIMIT if is_limit else FailureKind.RETRYABLE
        return self.failed(format_reason(_CARTESIAN_CODES, msg, self.status_text()), status, kind)


class move_tool_to_object(_ToolMotion):
    """Moves the tool to the object from above, with the fingers across its narrower side."""

    def createDescription(self) -> None:
        self.setDescription(MoveToolToObject(), self.__class__.__name__)

    def doing(self) -> str:
        return f"{'Moving above' if self.value('Height') > 0 else 'Reaching for'} {self.label_of('Object')}"

    def buildGoal(self) -> CartesianMotionGoal:
        thing = self.element("Object")
        frame, pose = pose_in_scene(self.wmi, thing)
        grasp = grasp_of(box_of(self.wmi, thing), self.ahead(pose), opening(self.element("Gripper")))
        return CartesianMotionGoal(
            target=stamped(frame, above(grasp, self.value("Height"))),
            speed=self.value("Speed"),
            max_force=self.value("MaxForce"),
        )


class move_tool_to_container(_ToolMotion):
    """Moves a held object to the middle of the container, or above it."""

    def createDescription(self) -> None:
        self.setDescription(MoveToolToContainer(), self.__class__.__name__)

    def doing(self) -> str:
        what = "Putting it down in" if self.value("ContactForce") > 0 else "Moving above"
        return f"{what} {self.label_of('Container')}"

    def buildGoal(self) -> CartesianMotionGoal:
        container, thing = self.element("Container"), self.element("Object")
        frame, pose = pose_in_scene(self.wmi, container)
        target = release_of(box_of(self.wmi, container), self._held(thing), self.ahead(pose))
        until_contact = self.value("ContactForce") > 0
        return CartesianMotionGoal(
            target=stamped(frame, above(target, -_GIVE if until_contact else self.value("Height"))),
            speed=self.value("Speed"),
            max_force=self.value("MaxForce"),
            contact_force=self.value("ContactForce"),
        )

    def _held(self, thing: Element) -> Box:
        """Returns pose in the tool frame, and size.

        :raises WrongValue: the gripper does not hold the object.
        """
        holder, pose = parent_of(self.wmi, thing), space.pose_of(thing)
        if holder is None or holder.id != self.element("Gripper").id or pose is None:
            raise WrongValue(f"{thing.label!r} is not in {self.label_of('Gripper')!r}")
        return Box(pose, size_of(thing))


class lift_tool(_ToolMotion):
    """Moves back along the axis of the tool."""

    def createDescription(self) -> None:
        self.setDescription(LiftTool(), self.__class__.__name__)

    def doing(self) -> str:
        return "Lifting the gripper"

    def buildGoal(self) -> CartesianMotionGoal:
        arm, gripper = self.element("Arm"), self.element("Gripper")
        frame = TOOL_FRAME.of(gripper, robot_name(self.element("Robot")), part_name(arm))
        return CartesianMotionGoal(
            target=stamped(frame, above(IDENTITY, -self.value("Height"))), speed=self.value("Speed")
        )


def format_reason(codes: dict[int, str], result: Message | None, text: str) -> str:
    """Describes a result: its code, and the text of the driver."""
    words = codes.get(getattr(result, "error_code", 0), "")
    own = str(getattr(result, "error_string", "") or text)
    return f"{words} ({own})" if words and own and own != words else words or own
