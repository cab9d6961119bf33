"""Goals of driver actions as motions of the simulated world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, WrenchStamped
from move_base_msgs.msg import MoveBaseFeedback, MoveBaseGoal, MoveBaseResult
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectoryPoint

from control_msgs.msg import (
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GripperCommandFeedback,
    GripperCommandGoal,
    GripperCommandResult,
)
from control_msgs.msg import JointTolerance as JointToleranceMessage
from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, composed, inverted
from skiros2_motion.core.motion import Outcome
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.base_motion import BaseMotion
from skiros2_sim.core.cartesian_motion import INVALID_GOAL, CartesianGoal, CartesianMotion
from skiros2_sim.core.gripper import GripperMotion
from skiros2_sim.core.joint_motion import JointGoal, JointMotion, JointPoint, JointState, JointTolerance
from skiros2_sim.core.reference_motion import ReferenceMotion, TrajectoryGoal
from skiros2_sim.core.world import World
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.messages import pose_from, pose_message, wrench_message
from skiros2_sim.ros.publishers import SimulatedClock
from skiros2_sim_msgs.msg import (
    CartesianMotionFeedback,
    CartesianMotionGoal,
    CartesianMotionResult,
    CartesianTrajectoryFeedback,
    CartesianTrajectoryGoal,
    CartesianTrajectoryResult,
)

M = TypeVar("M", GripperCommandFeedback, GripperCommandResult)

#: Maximum number of points of a trajectory: checking 2000 takes 50 ms.
_MAX_POINTS = 2_000


class JointJob:
    """A goal of control_msgs/FollowJointTrajectory.

    :param controllers: controllers by id of the arm; replaced by a reset.
    :raises WrongValue: the goal has too many points.
    """

    def __init__(
        self,
        goal: FollowJointTrajectoryGoal,
        arm: str,
        controllers: dict[str, ArmController],
        clock: SimulatedClock,
    ) -> None:
        points = goal.trajectory.points
        if len(points) > _MAX_POINTS:
            raise WrongValue(f"the trajectory has {len(points)} points, expected up to {_MAX_POINTS}")
        self._goal = goal
        self._arm = arm
        self._controllers = controllers
        self._clock = clock

    def begin(self, world: World) -> JointMotion:
        goal = self._goal
        stamp = goal.trajectory.header.stamp
        self._motion = JointMotion(
            self._controllers[self._arm],
            JointGoal(
                joints=tuple(goal.trajectory.joint_names),
                points=tuple(map(_point, goal.trajectory.points)),
                start=world.time + stamp.to_sec() - self._clock.seconds if stamp else None,
                path_tolerance=_tolerances(goal.path_tolerance),
                goal_tolerance=_tolerances(goal.goal_tolerance),
                goal_time_tolerance=goal.goal_time_tolerance.to_sec(),
            ),
        )
        return self._motion

    def feedback(self) -> FollowJointTrajectoryFeedback:
        desired, actual, error = map(_state, self._motion.feedback())
        header = Header(stamp=self._clock.now)
        return FollowJointTrajectoryFeedback(header, list(self._motion.joint_names), desired, actual, error)

    def result(self, outcome: Outcome) -> FollowJointTrajectoryResult:
        return FollowJointTrajectoryResult(outcome.code, outcome.text)


def refused_trajectory(text: str) -> FollowJointTrajectoryResult:
    """Returns the result of a rejected goal."""
    return FollowJointTrajectoryResult(INVALID_GOAL, text)


class CartesianJob:
    """A goal of skiros2_sim_msgs/CartesianMotion. May block on tf for an unknown frame of the target.

    :raises WrongValue: the target is not a valid pose.
    :raises UnknownName: the frame does not exist.
    """

    def __init__(
        self,
        goal: CartesianMotionGoal,
        arm: str,
        controllers: dict[str, ArmController],
        clock: SimulatedClock,
        frames: Frames,
    ) -> None:
        self._goal = goal
        self._arm = arm
        self._controllers = controllers
        self._clock = clock
        self._pose = pose_from(goal.target.pose, "target")
        self._frame = goal.target.header.frame_id or frames.map
        self._reference = frames.reference(self._frame)
        self._origin = IDENTITY

    def begin(self, world: World) -> CartesianMotion:
        goal = self._goal
        self._origin = self._reference(world)
        self._motion = CartesianMotion(
            self._controllers[self._arm],
            CartesianGoal(
                target=composed(self._origin, self._pose),
                speed=goal.speed,
                angular_speed=goal.angular_speed,
                controller=goal.controller,
                stiffness=tuple(goal.stiffness),
                max_force=goal.max_force,
                max_torque=goal.max_torque,
                contact_force=goal.contact_force,
                position_tolerance=goal.position_tolerance,
                orientation_tolerance=goal.orientation_tolerance,
                timeout=goal.timeout,
            ),
        )
        return self._motion

    def feedback(self) -> CartesianMotionFeedback:
        return CartesianMotionFeedback(*self._felt(), self._motion.feedback().distance)

    def result(self, outcome: Outcome) -> CartesianMotionResult:
        return CartesianMotionResult(outcome.code, outcome.text, *self._felt())

    def _felt(self) -> tuple[PoseStamped, WrenchStamped]:
        """Returns the pose of the tool in the initial frame of the target, and the wrench."""
        feeling = self._motion.feedback()
        controller = self._controllers[self._arm]
        stamp = self._clock.now
        tool = f"{controller.robot.name}/{controller.arm.name}/tool"
        return (
            PoseStamped(Header(stamp=stamp, frame_id=self._frame), _transformed(self._origin, feeling.pose)),
            WrenchStamped(Header(stamp=stamp, frame_id=tool), wrench_message(feeling.wrench)),
        )


def refused_motion(text: str) -> CartesianMotionResult:
    """Returns the result of a rejected goal."""
    result = CartesianMotionResult(error_code=INVALID_GOAL, error_string=text)
    result.pose.pose = pose_message(IDENTITY)
    return result


class TrajectoryJob:
    """A goal of skiros2_sim_msgs/CartesianTrajectory. May block on tf for an unknown frame.

    :raises WrongValue: a pose is not valid.
    :raises UnknownName: a frame does not exist.
    """

    def __init__(
        self, goal: CartesianTrajectoryGoal, arm: str, controllers: dict[str, ArmController], frames: Frames
    ) -> None:
        if not goal.goal.header.frame_id:
            raise WrongValue("goal: the frame is empty: expected a tf frame")
        self._goal = goal
        self._arm = arm
        self._controllers = controllers
        self._end = frames.reference(goal.goal.header.frame_id), pose_from(goal.goal.pose, "goal")
        self._start = None
        if goal.start.header.frame_id:
            self._start = frames.reference(goal.start.header.frame_id), pose_from(goal.start.pose, "start")

    def begin(self, world: World) -> ReferenceMotion:
        controller, goal = self._controllers[self._arm], self._goal
        base = inverted(controller.robot.pose())
        end, start = (
            composed(base, composed(pose[0](world), pose[1])) if pose is not None else None
            for pose in (self._end, self._start)
        )
        assert end is not None
        self._motion = ReferenceMotion(
            controller,
            TrajectoryGoal(
                end,
                start,
                goal.speed,
                goal.angular_speed,
                goal.translational_tolerance,
                goal.rotational_tolerance,
                goal.goal_time_tolerance,
            ),
        )
        return self._motion

    def feedback(self) -> CartesianTrajectoryFeedback:
        return CartesianTrajectoryFeedback(self._motion.progress, *self._motion.errors())

    def result(self, outcome: Outcome) -> CartesianTrajectoryResult:
        return CartesianTrajectoryResult(outcome.code, outcome.text)


def refused_reference_motion(text: str) -> CartesianTrajectoryResult:
    """Returns the result of a rejected goal."""
    return CartesianTrajectoryResult(INVALID_GOAL, text)


class GripperJob:
    """A goal of control_msgs/GripperCommand: `position` is the distance between the fingers (m)."""

    def __init__(self, goal: GripperCommandGoal, gripper: str) -> None:
        self._command = goal.command
        self._gripper = gripper

    def begin(self, world: World) -> GripperMotion:
        self._motion = GripperMotion(world.grippers[self._gripper], self._command.position, self._command.max_effort)
        return self._motion

    def feedback(self) -> GripperCommandFeedback:
        return self._message(GripperCommandFeedback)

    def result(self, outcome: Outcome) -> GripperCommandResult:
        return self._message(GripperCommandResult)

    def _message(self, kind: type[M]) -> M:
        motion = self._motion
        return kind(motion.width, motion.effort, motion.stalled, motion.reached_goal)


class BaseJob:
    """A goal of move_base_msgs/MoveBase. May block on tf for an unknown frame of the target.

    :raises WrongValue: the target is not a valid pose.
    :raises UnknownName: the frame does not exist.
    """

    def __init__(self, goal: MoveBaseGoal, robot: str, clock: SimulatedClock, frames: Frames) -> None:
        self._robot = robot
        self._clock = clock
        self._frames = frames
        self._pose = pose_from(goal.target_pose.pose, "target")
        self._reference = frames.reference(goal.target_pose.header.frame_id)

    def begin(self, world: World) -> BaseMotion:
        self._world = world
        pose = composed(self._reference(world), self._pose)
        return BaseMotion.to_pose(world, world.robots[self._robot], pose)

    def feedback(self) -> MoveBaseFeedback:
        pose = self._world.pose_of(self._robot)
        header = Header(stamp=self._clock.now, frame_id=self._frames.map)
        return MoveBaseFeedback(PoseStamped(header, pose_message(pose)))

    def result(self, outcome: Outcome) -> MoveBaseResult:
        return MoveBaseResult()


def _point(message: JointTrajectoryPoint) -> JointPoint:
    return JointPoint(
        message.time_from_start.to_sec(),
        tuple(message.positions),
        tuple(message.velocities),
        tuple(message.accelerations),
    )


def _tolerances(messages: Sequence[JointToleranceMessage]) -> dict[str, JointTolerance]:
    return {m.name: JointTolerance(m.position, m.velocity) for m in messages}


def _state(state: JointState) -> JointTrajectoryPoint:
    return JointTrajectoryPoint(positions=state.positions.tolist(), velocities=state.velocities.tolist())


def _transformed(frame: Pose, pose: Pose) -> PoseMessage:
    return pose_message(composed(inverted(frame), pose))
