"""Goals of skiros2_sim_msgs/PlanMotion as searches in the simulated world."""

from __future__ import annotations

import rospy
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import composed
from skiros2_motion.core.motion import Outcome
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.arm_planning import INVALID_GOAL, ArmPlanning, Plan, PlanningGoal
from skiros2_sim.core.planning_scene import PlanningScene
from skiros2_sim.core.world import World
from skiros2_sim.ros.frames import Frames
from skiros2_sim.ros.messages import pose_from
from skiros2_sim_msgs.msg import PlanMotionFeedback, PlanMotionGoal, PlanMotionResult


class PlanningJob:
    """A goal of skiros2_sim_msgs/PlanMotion. May block on tf for an unknown frame of the target.

    :param controllers: controllers by id of the arm; replaced by a reset.
    :param scene: used by one search at a time.
    :raises WrongValue: the target is not a valid pose.
    :raises UnknownName: the frame does not exist.
    """

    def __init__(
        self,
        goal: PlanMotionGoal,
        arm: str,
        controllers: dict[str, ArmController],
        scene: PlanningScene,
        frames: Frames,
    ) -> None:
        self._goal, self._arm, self._controllers, self._scene = goal, arm, controllers, scene
        frame = goal.target.header.frame_id
        q = goal.target.pose.orientation
        if not frame and any((q.x, q.y, q.z, q.w)):
            raise WrongValue(f"the target has no frame; the simulated world is in {frames.map!r}")
        self._pose = pose_from(goal.target.pose, "target") if frame else None
        self._reference = frames.reference(frame)

    def begin(self, world: World) -> ArmPlanning:
        goal = self._goal
        tool = None if self._pose is None else composed(self._reference(world), self._pose)
        self._search = ArmPlanning(
            self._controllers[self._arm],
            PlanningGoal(
                joints=tuple(goal.joint_names),
                positions=tuple(goal.positions),
                tool=tool,
                planning_time=goal.planning_time,
                clearance=goal.clearance,
                velocity_scaling=goal.velocity_scaling,
                acceleration_scaling=goal.acceleration_scaling,
                seed=goal.seed,
            ),
            self._scene,
        )
        return self._search

    def feedback(self) -> PlanMotionFeedback:
        return PlanMotionFeedback(self._search.spent)

    def result(self, outcome: Outcome) -> PlanMotionResult:
        return plan_result(self._search, outcome)


def plan_result(search: ArmPlanning, outcome: Outcome | None = None) -> PlanMotionResult:
    """Returns the result of a search.

    :param outcome: None for that of the search, which has ended.
    """
    ended = outcome or search.outcome
    assert ended is not None
    return PlanMotionResult(ended.code, ended.text, _trajectory(search.plan), search.spent)


def refused_plan(text: str) -> PlanMotionResult:
    """Returns the result of a rejected goal."""
    return PlanMotionResult(error_code=INVALID_GOAL, error_string=text)


def _trajectory(plan: Plan) -> JointTrajectory:
    return JointTrajectory(
        joint_names=list(plan.joints),
        points=[
            JointTrajectoryPoint(
                positions=list(point.positions),
                velocities=list(point.velocities),
                time_from_start=rospy.Duration.from_sec(point.time),
            )
            for point in plan.points
        ],
    )
