"""Collision-free motions of an arm: with skiros2_sim_msgs/PlanMotion; with MoveIt if it has `skiros:MoveItGroup`."""

from __future__ import annotations

import importlib
from typing import Any

from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped

from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_sim_msgs.msg import PlanMotionAction, PlanMotionFeedback, PlanMotionGoal
from skiros2_sim_skills.arm_motions import JOINT_CODES, format_reason
from skiros2_sim_skills.base_motion import stamped
from skiros2_sim_skills.motions import MoveArmCollisionFree
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_std_skills.core.devices import name_of, posture
from skiros2_std_skills.core.driver_names import MOVEIT_GROUP, PLANNER, TRAJECTORY
from skiros2_std_skills.drivers import DriverAction

_PLANNING_CODES = {
    PlanMotionGoal.INVALID_GOAL: "the planner rejects the goal",
    PlanMotionGoal.UNREACHABLE: "out of reach of the arm",
    PlanMotionGoal.START_IN_COLLISION: "the arm is in collision",
    PlanMotionGoal.GOAL_IN_COLLISION: "the goal is in collision",
    PlanMotionGoal.NO_PATH: "no collision-free path was found",
    PlanMotionGoal.PREEMPTED: "preempted by another plan",
}
#: MoveIt's code of a success, and its default action.
_MOVEIT_SUCCESS = 1
_MOVE_GROUP = "/move_group"
#: Tolerances of goals for MoveIt: rad (or m) of a joint; m and rad of the tool.
_JOINT_TOLERANCE, _POSITION_TOLERANCE, _ORIENTATION_TOLERANCE = 0.001, 0.001, 0.005


class move_arm_collision_free(DriverAction):
    """Plans a trajectory, then has the arm follow it. MoveIt does both with one goal."""

    def createDescription(self) -> None:
        self.setDescription(MoveArmCollisionFree(), self.__class__.__name__)

    def address(self) -> tuple[str, type]:
        arm = self.element("Arm")
        self._executes = False
        if self._group():
            messages = moveit_messages(arm.label or arm.id)
            return str(arm.value_of(PLANNER.key) or _MOVE_GROUP), messages.MoveGroupAction
        return name_of(PLANNER, self.element("Robot"), arm), PlanMotionAction

    def doing(self) -> str:
        goal = f"posture {self.value('Posture')!r}" if self.value("Posture") else self.label_of("Target")
        return f"Moving the arm without collisions to {goal}"

    def buildGoal(self) -> Any:
        """Returns the goal of the planner or of MoveIt.

        :raises WrongValue: neither or both of posture and target are given, or one is unknown.
        """
        name, target = self.value("Posture"), self.element("Target")
        if bool(name) == (target.getIdNumber() >= 0):
            raise WrongValue("expected either a posture or a target")
        joints = posture(self.element("Arm"), name) if name else {}
        pose = None if name else stamped(*pose_in_scene(self.wmi, target))
        return self._moveit_goal(joints, pose) if self._group() else self._goal_message(joints, pose)

    def onFeedback(self, msg: Any) -> State:
        if isinstance(msg, PlanMotionFeedback):
            return self.step(f"{self.doing()}: planning for {msg.planning_time:.1f} s")
        return self.step(self.doing())

    def onDone(self, status: int, msg: Any) -> State:
        if self._executes:
            if status == GoalStatus.SUCCEEDED:
                return self.success(f"{self.doing()}: there")
            return self.failed(format_reason(JOINT_CODES, msg, self.status_text()), status)
        if self._group():
            code = getattr(getattr(msg, "error_code", None), "val", None)
            if status == GoalStatus.SUCCEEDED and code in (None, _MOVEIT_SUCCESS):
                return self.success(f"{self.doing()}: there")
            return self.failed(f"MoveIt ended with error code {code} ({self.status_text()})", status)
        if status != GoalStatus.SUCCEEDED:
            return self.failed(format_reason(_PLANNING_CODES, msg, self.status_text()), status)
        self._executes = True
        planner, driver = self.client, name_of(TRAJECTORY, self.element("Robot"), self.element("Arm"))
        self.client = self.make_client(driver, FollowJointTrajectoryAction)
        self._close(planner)
        goal = FollowJointTrajectoryGoal(trajectory=msg.trajectory)
        return self.restart(goal, f"{self.doing()}: planned in {msg.planning_time:.1f} s")

    def _group(self) -> str:
        """Returns the planning group in MoveIt; "" if another planner plans for the arm."""
        return str(self.element("Arm").value_of(MOVEIT_GROUP) or "")

    def _goal_message(self, joints: dict[str, float], pose: PoseStamped | None) -> PlanMotionGoal:
        goal = PlanMotionGoal(
            joint_names=list(joints),
            positions=list(joints.values()),
            planning_time=self.value("PlanningTime"),
            clearance=self.value("Clearance"),
            velocity_scaling=self.value("Speed"),
            acceleration_scaling=self.value("Speed"),
        )
        if pose is not None:
            goal.target = pose
        return goal

    def _moveit_goal(self, joints: dict[str, float], pose: PoseStamped | None) -> Any:
        """Returns a `MoveGroupGoal` that plans and executes. The clearance is MoveIt's own padding of the robot."""
        arm = self.element("Arm")
        moveit = moveit_messages(arm.label or arm.id)
        goal = moveit.MoveGroupGoal()
        request = goal.request
        request.group_name = self._group()
        request.num_planning_attempts = 1
        request.allowed_planning_time = self.value("PlanningTime")
        request.max_velocity_scaling_factor = request.max_acceleration_scaling_factor = self.value("Speed")
        request.start_state.is_diff = True  # from the current state
        goal.planning_options.planning_scene_diff.is_diff = True
        goal.planning_options.planning_scene_diff.robot_state.is_diff = True
        constraints = moveit.Constraints()
        for name, position in joints.items():
            constraints.joint_constraints.append(
                moveit.JointConstraint(
                    joint_name=name,
                    position=position,
                    tolerance_above=_JOINT_TOLERANCE,
                    tolerance_below=_JOINT_TOLERANCE,
                    weight=1.0,
                )
            )
        if pose is not None:
            link = str(arm.value_of("skiros:MoveItTCPLink") or "")
            if not link:
                raise WrongValue(f"{arm.label!r} has no skiros:MoveItTCPLink: the link that goes to the target")
            shapes = importlib.import_module("shape_msgs.msg")
            ball = shapes.SolidPrimitive(type=shapes.SolidPrimitive.SPHERE, dimensions=[_POSITION_TOLERANCE])
            place = moveit.PositionConstraint(header=pose.header, link_name=link, weight=1.0)
            place.constraint_region.primitives.append(ball)
            place.constraint_region.primitive_poses.append(pose.pose)
            constraints.position_constraints.append(place)
            constraints.orientation_constraints.append(
                moveit.OrientationConstraint(
                    header=pose.header,
                    link_name=link,
                    orientation=pose.pose.orientation,
                    absolute_x_axis_tolerance=_ORIENTATION_TOLERANCE,
                    absolute_y_axis_tolerance=_ORIENTATION_TOLERANCE,
                    absolute_z_axis_tolerance=_ORIENTATION_TOLERANCE,
                    weight=1.0,
                )
            )
        request.goal_constraints.append(constraints)
        return goal


def moveit_messages(arm: str) -> Any:
    """Returns the module `moveit_msgs.msg`.

    :param arm: name of the arm that needs it.
    :raises ConfigurationError: it is not installed.
    """
    try:
        return importlib.import_module("moveit_msgs.msg")
    except ImportError:
        raise ConfigurationError(
            f"{arm!r} has {MOVEIT_GROUP}, so MoveIt plans for it, but the package moveit_msgs is not installed; "
            f"install it, or remove the property to use {PLANNER.key} with skiros2_sim_msgs/PlanMotion"
        ) from None
