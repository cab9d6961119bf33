"""The actions of simulated robots."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from typing import Any

import actionlib
import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Vector3, Wrench
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from control_msgs.msg import (
    FollowJointTrajectoryAction,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GripperCommand,
    GripperCommandAction,
    GripperCommandGoal,
)
from controller_manager_msgs.srv import SwitchController, SwitchControllerRequest
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_sim_msgs.msg import CartesianMotionAction, CartesianMotionGoal, PlanMotionAction, PlanMotionGoal
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from support.ros import wait_until
from support.simulator_client import GRIPPER, ROBOT, WAIT, SimulatorClient, pose_stamped

pytestmark = pytest.mark.timeout(120)

JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
#: Where the arm is at the start, and a bit beside it.
REST = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
ASIDE = (0.4, -0.6, 0.0, -2.2, 0.0, 1.6, 0.785)


class Request:
    """A sent goal with its messages."""

    def __init__(self, client: Any, goal: Any) -> None:
        self.feedback: list[Any] = []
        # not SimpleActionClient.send_goal, which forgets the goal before
        self.handle = client.action_client.send_goal(goal)
        # nor its feedback: what the result overtakes is left out there
        topic = client.action_client.feedback_sub
        self._subscriber = rospy.Subscriber(topic.resolved_name, topic.data_class, self._take)

    @property
    def status(self) -> int:
        return int(self.handle.get_goal_status())

    @property
    def text(self) -> str:
        return str(self.handle.get_goal_status_text())

    @property
    def ended(self) -> bool:
        return self.handle.get_result() is not None and self.handle.get_terminal_state() is not None

    def wait(self) -> Any:
        """Its result."""
        return wait_until(self.handle.get_result, WAIT, "a result")

    def wait_for_feedback(self, condition: Callable[[Any], bool]) -> Any:
        """The first one that is as wanted."""
        return wait_until(lambda: next(filter(condition, list(self.feedback)), None), WAIT, "feedback")

    def _take(self, message: Any) -> None:
        if message.status.goal_id.id == self.handle.comm_state_machine.action_goal.goal_id.id:
            self.feedback.append(message.feedback)

    def wait_until_active(self) -> None:
        wait_until(lambda: self.status == GoalStatus.ACTIVE, WAIT, "the start")


def move_arm(sim: SimulatorClient, positions: Any = ASIDE, seconds: float = 2.0, joints: Any = JOINTS) -> Request:
    client = sim.client("/mobile_manipulator/arm/follow_joint_trajectory", FollowJointTrajectoryAction)
    point = JointTrajectoryPoint(positions=list(positions), time_from_start=rospy.Duration.from_sec(seconds))
    return Request(client, FollowJointTrajectoryGoal(trajectory=JointTrajectory(joint_names=joints, points=[point])))


def move_tool(sim: SimulatorClient, target: Any, **options: Any) -> Request:
    client = sim.client("/mobile_manipulator/arm/cartesian_motion", CartesianMotionAction)
    return Request(client, CartesianMotionGoal(target=target, **options))


def move_fingers(sim: SimulatorClient, width: float, effort: float = 20.0) -> Request:
    client = sim.client("/mobile_manipulator/gripper/gripper_action", GripperCommandAction)
    return Request(client, GripperCommandGoal(GripperCommand(width, effort)))


def drive(sim: SimulatorClient, target: Any) -> Request:
    return Request(sim.client("/mobile_manipulator/move_base", MoveBaseAction), MoveBaseGoal(target))


# -- goals that are reached -------------------------------------------------------------------------------------------


def test_arm_follows_a_trajectory_with_feedback(sim: SimulatorClient) -> None:
    request = move_arm(sim)
    request.wait_until_active()
    with sim.running():
        assert request.wait().error_code == FollowJointTrajectoryResult.SUCCESSFUL
    at_the_end = request.wait_for_feedback(lambda told: told.actual.positions == pytest.approx(ASIDE, abs=0.05))
    assert 15 <= len(request.feedback) <= 45  # 10 Hz of 2 s and the time for the goal
    assert at_the_end.joint_names == JOINTS


def test_a_tool_moves_on_a_line_in_the_frame_of_the_target(sim: SimulatorClient) -> None:
    before = sim.position(GRIPPER)
    # the tool looks down: back along its own z is up
    request = move_tool(sim, pose_stamped((0, 0, -0.1), frame="mobile_manipulator/arm/tool"))
    request.wait_until_active()
    with sim.running():
        result = request.wait()
    assert (result.error_code, result.error_string) == (0, "")
    assert sim.position(GRIPPER) == pytest.approx((before[0], before[1], before[2] + 0.1), abs=0.005)
    assert result.pose.header.frame_id == "mobile_manipulator/arm/tool"
    assert result.pose.pose.position.z == pytest.approx(-0.1, abs=0.005)
    assert result.wrench.header.frame_id == "mobile_manipulator/arm/tool"
    assert request.wait_for_feedback(lambda told: told.distance < request.feedback[0].distance)


def test_a_gripper_opens_and_closes(sim: SimulatorClient) -> None:
    for width in (0.06, 0.0):
        request = move_fingers(sim, width)
        with sim.running():
            result = request.wait()
        assert (result.reached_goal, result.stalled) == (True, False)
        assert result.position == pytest.approx(width, abs=0.002)


def test_a_base_drives_to_a_place_in_any_frame(sim: SimulatorClient) -> None:
    request = drive(sim, pose_stamped((0.5, 0.3, 0.0), frame="mobile_manipulator/base_link"))
    request.wait_until_active()
    with sim.running():
        request.wait()
    assert request.status == GoalStatus.SUCCEEDED
    assert sim.position(ROBOT) == pytest.approx((0.5, 0.3, 0.0), abs=0.015)
    assert request.wait_for_feedback(lambda told: True).base_position.header.frame_id == "map"


# -- goals that end before their time ---------------------------------------------------------------------------------


def test_new_goal_replaces_the_old_one(sim: SimulatorClient) -> None:
    first = move_arm(sim)
    first.wait_until_active()
    sim.step(120)
    second = move_arm(sim, REST)
    first.wait()
    assert (first.status, first.text) == (GoalStatus.PREEMPTED, "another goal took its place")
    with sim.running():
        assert second.wait().error_code == FollowJointTrajectoryResult.SUCCESSFUL


def test_cancelled_goal_ends_with_the_device_at_rest(sim: SimulatorClient) -> None:
    for send in (lambda: move_arm(sim), lambda: drive(sim, pose_stamped((1.0, 0.0, 0.0)))):
        request = send()
        request.wait_until_active()
        sim.step(240)
        request.handle.cancel()
        wait_until(lambda request=request: request.status == GoalStatus.PREEMPTING, WAIT)
        with sim.running():
            request.wait()
        assert request.status == GoalStatus.PREEMPTED
    twist = sim.get_pose(ROBOT, "").twist
    assert math.hypot(twist.linear.x, twist.linear.y) < 0.02
    assert sim.position(ROBOT)[0] < 0.9


def test_goals_of_one_arm_exclude_each_other(sim: SimulatorClient) -> None:
    joints = move_arm(sim)
    joints.wait_until_active()
    result = move_tool(sim, pose_stamped((0, 0, -0.1), frame="mobile_manipulator/arm/tool")).wait()
    assert result.error_code == -1
    assert "is executing a goal of /mobile_manipulator/arm/follow_joint_trajectory" in result.error_string
    joints.handle.cancel()
    with sim.running():
        joints.wait()
    assert joints.status == GoalStatus.PREEMPTED


def test_goals_are_aborted_when_the_world_is_reset(sim: SimulatorClient) -> None:
    request = move_arm(sim)
    request.wait_until_active()
    sim.step(24)
    sim.reset()
    assert request.wait().error_string == "the simulated world was reset"
    assert request.status == GoalStatus.ABORTED


def test_stepped_trajectory_is_repeatable_after_a_reset(sim: SimulatorClient) -> None:
    def run() -> list[tuple[float, ...]]:
        sim.reset()
        way = []
        for request in (move_arm(sim), drive(sim, pose_stamped((0.4, 0.4, 0.0)))):
            request.wait_until_active()
        for _ in range(4):
            sim.step(60)
            way.append((*sim.position(GRIPPER), *sim.position(ROBOT)))
        return way

    assert run() == run()


# -- goals that cannot be ---------------------------------------------------------------------------------------------

NAN = math.nan
FAR = pose_stamped((30.0, 0.0, 1.0))
Send = Callable[[SimulatorClient], Request]

REFUSED: dict[str, tuple[Send, str]] = {
    "unknown joint": (lambda sim: move_arm(sim, joints=["knee", *JOINTS[1:]]), "knee"),
    "missing joint": (lambda sim: move_arm(sim, ASIDE[1:], joints=JOINTS[1:]), "panda_joint1 is missing"),
    "no number": (lambda sim: move_arm(sim, (NAN, *ASIDE[1:])), "not finite"),
    "beyond limits": (lambda sim: move_arm(sim, (9.0, *ASIDE[1:])), "beyond its limits"),
    "too fast": (lambda sim: move_arm(sim, seconds=0.01), "its limit is"),
    "tool to no number": (lambda sim: move_tool(sim, pose_stamped((NAN, 0, 0))), "target: position"),
    "tool to no orientation": (lambda sim: move_tool(sim, pose_stamped((0, 0, 0), (0, 0, 0, 0))), "length 1"),
    "tool in no frame": (lambda sim: move_tool(sim, pose_stamped((0, 0, 0), frame="nowhere")), "'nowhere'"),
    "no controller": (lambda sim: move_tool(sim, FAR, controller="magic"), ""),
    "gripper too wide": (lambda sim: move_fingers(sim, 7.0), "opens from"),
    "gripper to no number": (lambda sim: move_fingers(sim, NAN), "opens from"),
    "gripper with no effort": (lambda sim: move_fingers(sim, 0.0, -1.0), "effort"),
    "drive into a table": (lambda sim: drive(sim, pose_stamped((2.0, 1.5, 0.0))), "demo:Workstation-6"),
    "drive to no number": (lambda sim: drive(sim, pose_stamped((NAN, 0, 0))), "target: position"),
    "drive in no frame": (lambda sim: drive(sim, pose_stamped((0, 0, 0), frame="nowhere")), "'nowhere'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_impossible_goals_are_rejected_without_motion(shared_sim: SimulatorClient, case: str) -> None:
    send, reason = REFUSED[case]
    request = send(shared_sim)
    result = request.wait()
    assert request.status == GoalStatus.REJECTED
    assert request.text
    assert reason in request.text
    assert getattr(result, "error_string", request.text) == request.text


def test_unreachable_tool_pose_aborts_with_the_reason(sim: SimulatorClient) -> None:
    before = sim.position(GRIPPER)
    request = move_tool(sim, FAR)
    request.wait_until_active()
    sim.step(60)
    result = request.wait()
    assert (request.status, result.error_code) == (GoalStatus.ABORTED, CartesianMotionGoal.UNREACHABLE)
    assert "no joint positions reach the target" in result.error_string
    assert sim.position(GRIPPER) == pytest.approx(before, abs=0.001)


# -- controllers ------------------------------------------------------------------------------------------------------


def test_controllers_are_switched_as_by_a_controller_manager(sim: SimulatorClient) -> None:
    switch = sim.ros.service("/mobile_manipulator/controller_manager/switch_controller", SwitchController)
    strict, best_effort = SwitchControllerRequest.STRICT, SwitchControllerRequest.BEST_EFFORT

    def switched(start: list[str], stop: list[str], strictness: int) -> bool:
        return bool(switch(start, stop, strictness, True, 0.0).ok)

    assert switched(["compliant"], ["position"], strict)
    assert not switched(["compliant"], ["position"], strict), "it is on already"
    assert switched(["compliant"], ["position"], best_effort)
    assert not switched(["magic"], [], strict)
    assert switched(["magic"], [], best_effort)
    assert not switched([], ["compliant"], strict), "an arm needs one"
    assert not switched(["position", "compliant"], [], best_effort), "one at a time"
    before = sim.position(GRIPPER)
    sim.step(240)
    assert sim.position(GRIPPER) == pytest.approx(before, abs=0.02)  # it holds itself
    result = move_arm(sim).wait()
    assert "compliant" in result.error_string
    assert switched(["arm/position"], [], best_effort)
    moving = move_arm(sim)
    moving.wait_until_active()
    assert not switched(["compliant"], ["position"], strict), "it moves"


def test_the_stiffness_of_the_compliant_controller_is_a_topic(sim: SimulatorClient) -> None:
    switch = sim.ros.service("/mobile_manipulator/controller_manager/switch_controller", SwitchController)
    assert switch(["compliant"], ["position"], SwitchControllerRequest.STRICT, True, 0.0).ok
    topic = rospy.Publisher("/mobile_manipulator/arm/stiffness", Wrench, queue_size=1)
    wait_until(topic.get_num_connections, WAIT, "the arm at its topic")

    def sags(stiffness: float) -> float:
        topic.publish(Wrench(Vector3(stiffness, stiffness, stiffness), Vector3(20, 20, 20)))
        before = sim.position(GRIPPER)[2]
        sim.step(120)
        assert sim.push(GRIPPER, Wrench(Vector3(0, 0, -10), Vector3()), rospy.Duration.from_sec(1.0)).ok
        sim.step(240)
        return before - sim.position(GRIPPER)[2]

    wait_until(lambda: sags(100.0) > 0.04, WAIT, "an arm that gives way")
    topic.publish(Wrench(Vector3(math.nan, 0, 0), Vector3()))
    wait_until(lambda: "stiffness of arm" in sim.program.output, WAIT, "a warning")
    topic.unregister()


# -- planned motions --------------------------------------------------------------------------------------------------


def plan(sim: SimulatorClient, **goal: Any) -> Request:
    return Request(sim.client("/mobile_manipulator/arm/plan_motion", PlanMotionAction), PlanMotionGoal(**goal))


def follow(sim: SimulatorClient, trajectory: JointTrajectory) -> Request:
    client = sim.client("/mobile_manipulator/arm/follow_joint_trajectory", FollowJointTrajectoryAction)
    return Request(client, FollowJointTrajectoryGoal(trajectory=trajectory))


def test_a_planned_trajectory_is_followed(sim: SimulatorClient) -> None:
    target = pose_stamped((0.1, 0.3, -0.1), frame="mobile_manipulator/arm/tool")
    x, y, z = sim.position(GRIPPER)
    request = plan(sim, target=target, clearance=0.02)
    request.wait_until_active()
    with sim.running():
        result = request.wait()
        assert (result.error_code, request.status) == (PlanMotionGoal.SUCCESSFUL, GoalStatus.SUCCEEDED), request.text
        assert result.trajectory.joint_names == JOINTS
        motion = follow(sim, result.trajectory)
        assert motion.wait().error_code == FollowJointTrajectoryResult.SUCCESSFUL, motion.text
    # the tool looks down, its x axis forward
    assert sim.position(GRIPPER) == pytest.approx((x + 0.1, y - 0.3, z + 0.1), abs=0.01)


def test_same_seed_gives_the_same_plan(sim: SimulatorClient) -> None:
    trajectories = []
    for _ in range(2):
        sim.reset()
        request = plan(sim, joint_names=JOINTS, positions=ASIDE, seed=5)
        request.wait_until_active()
        with sim.running():
            trajectories.append(request.wait().trajectory)
    assert trajectories[0].points
    assert trajectories[0] == trajectories[1]


def test_impossible_plans_name_the_reason(sim: SimulatorClient) -> None:
    request = plan(sim, target=pose_stamped((9.0, 0.0, 0.5), (1, 0, 0, 0), "map"))
    with sim.running():
        assert request.wait().error_code == PlanMotionGoal.UNREACHABLE
    into_the_base = plan(sim, joint_names=JOINTS, positions=(3.1 - 0.3, 1.7, 0.0, -0.5, 0.0, 1.0, 0.0))
    with sim.running():
        result = into_the_base.wait()
    assert result.error_code == PlanMotionGoal.GOAL_IN_COLLISION
    assert "mobile_manipulator/arm/panda_" in result.error_string
    assert "mobile_manipulator/base" in result.error_string
    for goal, text in (
        ({"joint_names": JOINTS[:3], "positions": [0.0] * 3}, "panda_joint4"),
        ({"target": pose_stamped((0.5, 0.0, 0.5), frame="nowhere")}, "nowhere"),
        ({"target": pose_stamped((0.5, 0.0, 0.5))}, "no frame"),
        ({}, "either joint positions or a pose"),
        ({"joint_names": JOINTS, "positions": ASIDE, "clearance": math.nan}, "clearance nan"),
    ):
        rejected = plan(sim, **goal)
        assert rejected.wait().error_code == PlanMotionGoal.INVALID_GOAL
        assert rejected.status == GoalStatus.REJECTED
        assert text in rejected.text


def test_a_plan_is_cancelled_and_aborted_by_a_reset(sim: SimulatorClient) -> None:
    request = plan(sim, joint_names=JOINTS, positions=ASIDE)
    request.wait_until_active()
    request.handle.cancel()
    wait_until(lambda: request.handle.get_comm_state() == actionlib.CommState.PREEMPTING, WAIT, "the cancellation")
    with sim.running():
        assert request.wait().error_code == PlanMotionGoal.PREEMPTED
    request = plan(sim, joint_names=JOINTS, positions=ASIDE)
    request.wait_until_active()
    sim.reset()
    request.wait()
    assert "reset" in request.text


# -- its end ----------------------------------------------------------------------------------------------------------


class Turn(SkillDescription):
    pass


class turn_arm(PrimitiveActionClient):
    """A skill that sends an arm aside."""

    goal: Any = None

    def createDescription(self) -> None:
        self.setDescription(Turn(), "turn_arm")

    def buildClient(self) -> Any:
        name = "/mobile_manipulator/arm/follow_joint_trajectory"
        return actionlib.SimpleActionClient(name, FollowJointTrajectoryAction)

    def buildGoal(self) -> Any:
        point = JointTrajectoryPoint(positions=list(ASIDE), time_from_start=rospy.Duration(20))
        return FollowJointTrajectoryGoal(trajectory=JointTrajectory(joint_names=JOINTS, points=[point]))


def test_a_skill_whose_robot_is_lost_fails_with_the_reason(sim: SimulatorClient) -> None:
    # The last one: the simulator is started anew after each, perhaps so soon that it says it does not know the goal.
    ends = {signal.SIGINT: ("/sim ended before the goal did",), signal.SIGKILL: ("LOST", "has sent no status")}
    for starts, (number, reasons) in enumerate(ends.items(), start=1):
        wait_until(lambda starts=starts: sim.program.output.count("world is ready") == starts, WAIT, "a new simulator")
        skill = turn_arm()
        assert skill.init(None)
        skill.onStart()
        wait_until(lambda skill=skill: skill.execute() and skill.client.get_state() == GoalStatus.ACTIVE, WAIT)
        os.kill(sim.ros.master.node_pid("/sim"), number)
        wait_until(lambda skill=skill: skill.execute() is State.Failure, WAIT, "a skill that has failed")
        assert any(reason in skill.progress_msg for reason in reasons)
        skill.onEnd()
