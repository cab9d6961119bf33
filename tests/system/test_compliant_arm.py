"""Topics, services and actions of the compliant controller of a simulated arm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Pose, PoseStamped, Quaternion, Vector3, Wrench, WrenchStamped
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectoryPoint

from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal, FollowJointTrajectoryResult
from controller_manager_msgs.srv import ListControllers, SwitchController, SwitchControllerRequest
from skiros2_sim_msgs.msg import (
    CartesianTrajectoryAction,
    CartesianTrajectoryGoal,
    CartesianTrajectoryResult,
    ImpedanceState,
)
from skiros2_sim_msgs.srv import OverlayMotion, SetWrenchLimits
from support.ros import Ros, RosMaster, wait_until
from support.simulator_client import ARM as ARM_ID
from support.simulator_client import GRIPPER, WAIT, SimulatorClient

pytestmark = pytest.mark.timeout(120)

ROBOT = "/mobile_manipulator"
ARM = f"{ROBOT}/arm/compliant"
TOOL = "mobile_manipulator/arm/tool"
HOME = [0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8]
BASE = "mobile_manipulator/base_link"
COMMANDS = {
    "reference_pose": PoseStamped,
    "set_cartesian_stiffness": WrenchStamped,
    "set_damping_factors": WrenchStamped,
    "set_cartesian_wrench": WrenchStamped,
}


class Arm:
    """A client of the arm."""

    def __init__(self, sim: SimulatorClient) -> None:
        self.sim = sim
        self.states: list[ImpedanceState] = []
        self._subscriber = rospy.Subscriber(f"{ARM}/state", ImpedanceState, self.states.append)
        self._topics = {name: rospy.Publisher(f"{ARM}/{name}", kind, queue_size=10) for name, kind in COMMANDS.items()}
        for name, topic in self._topics.items():
            wait_until(topic.get_num_connections, WAIT, f"the arm at {name}")
        wait_until(self._subscriber.get_num_connections, WAIT, "the state of the arm")

    def close(self) -> None:
        self._subscriber.unregister()
        for topic in self._topics.values():
            topic.unregister()

    def switch(self, name: str, other: str) -> None:
        service = self.sim.ros.service(f"{ROBOT}/controller_manager/switch_controller", SwitchController)
        assert service([name], [other], SwitchControllerRequest.STRICT, True, 0.0).ok

    def send(self, name: str, message: Any) -> None:
        self._topics[name].publish(message)

    def state(self, steps: int = 24) -> ImpedanceState:
        """The state after some steps."""
        stamp = self.sim.step(steps).stamp
        # the state is published every second step
        late = rospy.Duration.from_sec(1.5 / 240)

        def newer() -> ImpedanceState | None:
            return next((state for state in list(self.states) if state.header.stamp >= stamp - late), None)

        return wait_until(newer, WAIT, "a state")

    def wait_for(self, condition: Any, steps: int = 24) -> ImpedanceState:
        """The first state that is as wanted, after at most a minute of stepping."""
        return wait_until(lambda: found if condition(found := self.state(steps)) else None, WAIT, "a state as wanted")


@pytest.fixture(scope="module")
def shared_sim(ros_master: RosMaster) -> Iterator[SimulatorClient]:
    ros = Ros(ros_master)
    try:
        client = SimulatorClient(ros, force_noise=0.05, wrench_bias="[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]")
        yield client
        client.close()
    finally:
        ros.stop()


@pytest.fixture
def arm(shared_sim: SimulatorClient) -> Iterator[Arm]:
    """A compliant arm at rest."""
    shared_sim.reset()
    client = Arm(shared_sim)
    client.switch("compliant", "position")
    yield client
    client.close()


def wrench(fx: float, fy: float, fz: float, torque: float = 0.0, frame: str = "") -> WrenchStamped:
    return WrenchStamped(Header(frame_id=frame), Wrench(Vector3(fx, fy, fz), Vector3(torque, torque, torque)))


def stamped(pose: Pose, dx: float = 0.0, frame: str = BASE) -> PoseStamped:
    made = PoseStamped(Header(frame_id=frame), Pose(pose.position, pose.orientation))
    made.pose.position.x += dx
    return made


def test_controllers_are_listed_with_their_states_and_joints(arm: Arm) -> None:
    found = arm.sim.ros.service(f"{ROBOT}/controller_manager/list_controllers", ListControllers)().controller
    assert [(c.name, c.state) for c in found] == [("position", "stopped"), ("compliant", "running")]
    assert found[1].claimed_resources[0].hardware_interface == "hardware_interface::EffortJointInterface"
    assert found[1].claimed_resources[0].resources[0] == "arm/panda_joint1"


def test_tool_follows_the_reference_pose(arm: Arm) -> None:
    start = arm.state()
    assert start.active
    assert (start.header.frame_id, len(start.joints), len(start.joint_torques)) == (BASE, 7, 7)
    target = stamped(start.pose, dx=-0.05)
    arm.send("reference_pose", target)
    state = arm.wait_for(lambda s: abs(s.pose.position.x - target.pose.position.x) < 0.003)
    assert state.reference.position.x == pytest.approx(target.pose.position.x, abs=1e-4)


def test_stiffness_damping_and_wrench_are_set_in_the_frame_of_the_tool(arm: Arm) -> None:
    arm.send("set_cartesian_stiffness", wrench(300.0, 300.0, 900.0, 30.0, TOOL))
    arm.send("set_damping_factors", wrench(1.0, 1.0, 0.5, 1.0))
    arm.send("set_cartesian_wrench", wrench(0.0, 0.0, 5.0))
    state = arm.wait_for(lambda s: abs(s.commanded_wrench.force.z - 5.0) < 0.01 and abs(s.stiffness.force.z - 900) < 1)
    assert state.stiffness.torque.x == pytest.approx(30.0, abs=0.1)
    assert state.damping_factors.force.z == 0.5
    # the tool moves along its z axis by force over stiffness
    settled = arm.wait_for(lambda s: abs(s.position_error.z - 5.0 / 900.0) < 0.001)
    assert abs(settled.position_error.x) < 0.003


def test_wrench_that_is_not_sent_again_expires(arm: Arm) -> None:
    arm.send("set_cartesian_wrench", wrench(0.0, 0.0, 5.0))
    arm.wait_for(lambda s: s.commanded_wrench.force.z > 4.9)
    arm.wait_for(lambda s: s.commanded_wrench.force.z < 0.1)
    assert "the commanded wrench was not set again in time" in arm.sim.program.output


def test_silent_sensor_stops_an_arm_with_limits(arm: Arm) -> None:
    assert arm.sim.ros.service(f"{ARM}/set_wrench_limits", SetWrenchLimits)(60.0, 20.0).ok
    measured = arm.sim.ros.messages(f"{ROBOT}/arm/wrist/wrench", WrenchStamped)
    wait_until(lambda: arm.state() and measured.all, WAIT, "a measured wrench")
    assert arm.sim.set_fault("silent_sensor", ARM_ID, True, 0.0, 0.0).ok
    stopped = arm.wait_for(lambda s: s.stopped_by)
    assert (stopped.stopped_by, stopped.stop_limit) == ("sensor_age", 0.02)
    assert stopped.wrench_stamp < stopped.stop_stamp
    later = arm.state(240)
    assert later.wrench_stamp.to_sec() == pytest.approx(stopped.wrench_stamp.to_sec(), abs=1e-6)
    assert measured.all[-1].header.stamp <= stopped.wrench_stamp + rospy.Duration.from_sec(0.01)
    assert arm.sim.set_fault("silent_sensor", ARM_ID, False, 0.0, 0.0).ok


def test_limit_under_position_control_aborts_a_trajectory(arm: Arm) -> None:
    arm.switch("position", "compliant")
    arm.state(240)
    assert arm.sim.ros.service(f"{ROBOT}/arm/wrist/zero", Trigger)().success
    set_limits = arm.sim.ros.service(f"{ROBOT}/arm/position/set_wrench_limits", SetWrenchLimits)
    assert "limits of force and torque" in set_limits(math.nan, 0.0).message
    assert set_limits(30.0, 0.0).ok
    client = arm.sim.client(f"{ROBOT}/arm/follow_joint_trajectory", FollowJointTrajectoryAction)
    names = [name.removeprefix("arm/") for name in arm.state().joints]
    goal = FollowJointTrajectoryGoal()
    goal.trajectory.joint_names = names
    goal.trajectory.points = [JointTrajectoryPoint(positions=HOME, time_from_start=rospy.Duration(20))]
    client.send_goal(goal)
    wait_until(lambda: arm.state() and client.get_state() != GoalStatus.PENDING, WAIT, "the motion")
    assert client.get_state() == GoalStatus.ACTIVE, client.get_goal_status_text()
    assert arm.sim.push(GRIPPER, Wrench(Vector3(60, 0, 0), Vector3()), rospy.Duration.from_sec(0.2)).ok
    stopped = arm.wait_for(lambda s: s.stopped_by)
    assert (stopped.stopped_by, stopped.stop_limit) == ("force", 30.0)
    with arm.sim.running():
        assert client.wait_for_result(rospy.Duration(WAIT))
    assert client.get_result().error_code == FollowJointTrajectoryResult.PATH_TOLERANCE_VIOLATED
    assert "stopped at a force" in client.get_result().error_string
    client.send_goal_and_wait(goal)
    assert client.get_state() == GoalStatus.REJECTED
    assert set_limits(0.0, 0.0).ok
    assert not arm.state().stopped_by


@pytest.mark.parametrize(
    ("name", "message", "reason"),
    [
        ("reference_pose", PoseStamped(Header(frame_id=BASE), Pose()), "expected a quaternion of length 1"),
        ("reference_pose", PoseStamped(Header(), Pose(orientation=Quaternion(0, 0, 0, 1))), "the frame is empty"),
        ("reference_pose", PoseStamped(Header(frame_id="moon"), Pose(orientation=Quaternion(0, 0, 0, 1))), "'moon'"),
        (
            "reference_pose",
            PoseStamped(Header(frame_id=BASE), Pose(Vector3(math.nan, 0, 0), Quaternion(0, 0, 0, 1))),
            "reference: position .nan",
        ),
        (
            "reference_pose",
            PoseStamped(Header(frame_id=BASE), Pose(Vector3(50, 0, 0), Quaternion(0, 0, 0, 1))),
            "expected up to 3 m",
        ),
        ("set_cartesian_stiffness", wrench(2001.0, 0, 0), "stiffness 2001 of x: expected 0 to 2000"),
        ("set_cartesian_stiffness", wrench(100, 100, 100, 10, "map"), "stiffness in frame 'map': expected"),
        ("set_damping_factors", wrench(-1.0, 0, 0), "damping factor -1 of x"),
        ("set_cartesian_wrench", wrench(0, 0, 31.0), "wrench 31 of z: expected -30 to 30"),
        (
            "set_cartesian_wrench",
            wrench(math.nan, 0, 0, frame="map"),
            "wrench in frame 'map': expected 'mobile_manipulator/arm/tool', or none; wrench along x, y, z .nan",
        ),
        ("set_cartesian_wrench", wrench(math.nan, 0, 0), "wrench along x, y, z .nan"),
    ],
)
def test_invalid_command_is_logged_once_and_changes_nothing(arm: Arm, name: str, message: Any, reason: str) -> None:
    before = arm.state(240)
    logged = arm.sim.program.output.count("a command is refused")
    arm.send(name, message)
    wait_until(lambda: arm.sim.program.output.count("a command is refused") > logged, WAIT, "a warning")
    line = [line for line in arm.sim.program.output.splitlines() if "a command is refused" in line][-1]
    assert f"{ARM}/{name}: a command is refused: " in line
    assert reason.replace(".nan", "(nan") in line
    after = arm.state(240)
    assert after.reference == before.reference
    assert (after.stiffness, after.damping_factors) == (before.stiffness, before.damping_factors)
    assert after.commanded_wrench == before.commanded_wrench
    assert after.pose.position.x == pytest.approx(before.pose.position.x, abs=0.002)


def test_commands_to_an_inactive_controller_are_refused(arm: Arm) -> None:
    pose = arm.state().pose
    arm.switch("position", "compliant")
    logged = arm.sim.program.output.count("is not active")
    arm.send("reference_pose", stamped(pose, dx=0.05))
    wait_until(lambda: arm.sim.program.output.count("is not active") > logged, WAIT, "a warning")
    assert not arm.state().active


def test_sensor_at_the_wrist_is_zeroed(arm: Arm) -> None:
    assert abs(arm.state(240).measured_wrench.force.x) > 1.0, "its bias"
    answer = arm.sim.ros.service(f"{ROBOT}/arm/wrist/zero", Trigger)()
    assert answer.success, answer.message
    arm.wait_for(lambda s: abs(s.measured_wrench.force.x) < 0.5)


def test_trajectory_moves_the_tool_with_feedback(arm: Arm) -> None:
    client = arm.sim.client(f"{ARM}/cartesian_trajectory", CartesianTrajectoryAction)
    target = stamped(arm.state(240).pose, dx=-0.08)
    progress: list[float] = []
    client.send_goal(
        CartesianTrajectoryGoal(goal=target), feedback_cb=lambda feedback: progress.append(feedback.progress)
    )
    with arm.sim.running():
        assert client.wait_for_result(rospy.Duration(WAIT))
    result = client.get_result()
    assert result.error_code == CartesianTrajectoryGoal.SUCCESSFUL, result.error_string
    assert arm.state().pose.position.x == pytest.approx(target.pose.position.x, abs=0.006)
    assert progress == sorted(progress)
    client.send_goal_and_wait(CartesianTrajectoryGoal(goal=stamped(target.pose, frame="")))
    assert client.get_state() == GoalStatus.REJECTED
    result: CartesianTrajectoryResult = client.get_result()
    assert "goal: the frame is empty" in result.error_string


def test_overlay_motion_is_added_to_the_reference_until_it_is_stopped(arm: Arm) -> None:
    overlay = arm.sim.ros.service(f"{ARM}/overlay_motion", OverlayMotion)
    refused = overlay(True, 5.0, 0.004, 0.03, Vector3(), True)
    assert not refused.ok
    assert "radius 5.0" in refused.message
    start = arm.state(240)
    assert overlay(True, 0.02, 0.01, 0.05, Vector3(), True).ok
    arm.wait_for(
        lambda s: (
            s.overlay
            and math.hypot(s.pose.position.x - start.pose.position.x, s.pose.position.y - start.pose.position.y) > 0.008
        )
    )
    assert overlay(False, 0.0, 0.0, 0.0, Vector3(), False).ok
    end = arm.wait_for(lambda s: not s.overlay and math.hypot(s.position_error.x, s.position_error.y) < 0.002)
    assert end.reference == start.reference


def test_exceeded_limit_stops_the_arm_and_is_in_the_state(arm: Arm) -> None:
    arm.state(240)
    assert arm.sim.ros.service(f"{ROBOT}/arm/wrist/zero", Trigger)().success
    set_limits = arm.sim.ros.service(f"{ARM}/set_wrench_limits", SetWrenchLimits)
    refused = set_limits(-1.0, 0.0)
    assert not refused.ok
    assert "limits of force and torque" in refused.message
    assert set_limits(10.0, 5.0).ok
    state = arm.state(240)
    assert (state.force_limit, state.torque_limit, state.stopped_by) == (10.0, 5.0, "")
    assert arm.sim.push(GRIPPER, Wrench(Vector3(15, 0, 0), Vector3()), rospy.Duration.from_sec(0.2)).ok
    stopped = arm.wait_for(lambda s: s.stopped_by)
    assert (stopped.stopped_by, stopped.stop_limit) == ("force", 10.0)
    assert stopped.stop_value > 10.0
    assert rospy.Time() < stopped.stop_stamp <= stopped.header.stamp
    logged = arm.sim.program.output.count("has stopped at a force")
    arm.send("reference_pose", stamped(stopped.pose, dx=0.1))
    wait_until(lambda: arm.sim.program.output.count("has stopped at a force") > logged, WAIT, "a warning")
    assert set_limits(30.0, 10.0).ok
    assert not arm.state().stopped_by
