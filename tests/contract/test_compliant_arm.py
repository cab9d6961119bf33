"""What contact skills rely on in every adapter of the port `CompliantArm`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import pytest
import rospy
from geometry_msgs.msg import Vector3, Wrench

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.ros.impedance_arm import ImpedanceArm
from skiros2_contact_skills.ros.profiles import PROFILES, STANDARD
from skiros2_contact_skills.ros.topic_arm import TopicArm
from skiros2_motion.core.compliant_arm import ArmState, CompliantArm, MeasuresPeak, RegulatesForce
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import Pose, Vector
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_sim.core.world import World
from support.ros import Ros, RosMaster, wait_until
from support.simulated_cell import ARM, GRIPPER, ROBOT, bench
from support.simulator_client import WAIT, SimulatorClient


class InProcess:
    """An arm of a world in this process."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.reset()

    def reset(self) -> None:
        """The arm is at rest in the air, its position controller is active."""
        self._world.reset(seed=0)
        controller = ArmController(self._world, self._world.robots[ROBOT], self._world.arms[ARM])
        self.arm: CompliantArm = SimulatedArm(controller)

    def advance(self, seconds: float) -> ArmState:
        """Lets time pass; returns the state after it."""
        self._world.step(round(seconds * self._world.rate))
        state = self.arm.state()
        assert state is not None
        return state

    def push(self, force: Vector, duration: float) -> None:
        """Pushes the hand with a force in the map (N) for some seconds."""
        self._world.push(GRIPPER, force, duration=duration)


class OverRos:
    """The arm of a simulator node."""

    def __init__(self, sim: SimulatorClient) -> None:
        self._sim = sim
        space, wrist = "/mobile_manipulator/arm/compliant", "/mobile_manipulator/arm/wrist"
        switch = "/mobile_manipulator/controller_manager/switch_controller"
        mount = Pose((0.3, 0.0, 0.39), (0.0, 0.0, 0.0, 1.0))
        self.arm: CompliantArm = ImpedanceArm("arm", space, wrist, switch, ("compliant", "position"), mount)

    def reset(self) -> None:
        self._sim.reset()

    def advance(self, seconds: float) -> ArmState:
        self._wait_for_state(0.0)  # the commands before have their effect
        return self._wait_for_state(self._sim.step(round(seconds * 240)).stamp.to_sec() - 0.011)

    def _wait_for_state(self, since: float) -> ArmState:
        end = time.monotonic() + WAIT

        def state() -> ArmState | None:
            found = self.arm.state()
            if found is not None and found.stamp >= since:
                return found
            assert time.monotonic() < end
            self._sim.step(3)  # answers take a moment, and are followed by new states
            return None

        return wait_until(state, WAIT, "a state")

    def push(self, force: Vector, duration: float) -> None:
        assert self._sim.push(GRIPPER, Wrench(Vector3(*force), Vector3()), rospy.Duration.from_sec(duration)).ok


class OverStandardMessages(OverRos):
    """The same arm, by messages that other drivers have too."""

    def __init__(self, sim: SimulatorClient) -> None:
        self._sim = sim
        names = {"robot": "mobile_manipulator", "arm": "arm", "space": "/mobile_manipulator/arm/compliant"}
        names |= {"compliant": "compliant", "position": "position", "sensor": "exact"}
        mount = Pose((0.3, 0.0, 0.39), (0.0, 0.0, 0.0, 1.0))
        self.arm: CompliantArm = TopicArm(PROFILES[STANDARD], names, mount)

    def advance(self, seconds: float) -> ArmState:
        """Ticks as a skill does: spirals are added at ticks."""
        for _ in range(max(1, round(seconds / 0.05)) - 1):
            super().advance(0.05)
        return super().advance(0.05)


Rig = InProcess | OverRos


@pytest.fixture(scope="module")
def simulated() -> Iterator[Callable[[], Rig]]:
    with World(bench()) as world:
        yield lambda: InProcess(world)


@pytest.fixture(scope="module")
def sim(ros_master: RosMaster) -> Iterator[SimulatorClient]:
    system = Ros(ros_master)
    try:
        sim = SimulatorClient(system)
        yield sim
        sim.close()
    finally:
        system.stop()


@pytest.fixture(scope="module")
def ros(sim: SimulatorClient) -> Callable[[], Rig]:
    rig = OverRos(sim)
    return lambda: rig


@pytest.fixture(scope="module")
def standard(sim: SimulatorClient) -> Callable[[], Rig]:
    rig = OverStandardMessages(sim)
    return lambda: rig


@pytest.fixture(params=["simulated", "ros", pytest.param("standard", marks=pytest.mark.long)])
def still(request: pytest.FixtureRequest) -> Rig:
    """An arm whose compliant controller is not active."""
    rig: Rig = request.getfixturevalue(request.param)()
    rig.reset()
    return rig


@pytest.fixture
def rig(still: Rig) -> Rig:
    """An arm with its compliant controller at rest in the air."""
    still.arm.set_wrench_limits(0.0, 0.0)
    still.arm.begin()
    still.arm.set_stiffness((600.0,) * 3, (40.0,) * 3)
    still.advance(0.5)
    return still


def moved(pose: Pose, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose((pose.position[0] + x, pose.position[1] + y, pose.position[2] + z), pose.orientation)


def test_arm_that_has_not_begun_reports_that_it_does_not_follow(still: Rig) -> None:
    state = still.advance(0.1)
    assert "is not active" in state.stopped
    assert state.kind is FailureKind.CONTROLLER


def test_pose_is_in_the_frame_of_the_mount_and_the_tool_points_down(rig: Rig) -> None:
    pose = rig.advance(0.1).pose
    assert 0.2 < pose.position[0] < 0.8
    assert abs(pose.position[1]) < 0.01
    assert abs(pose.orientation[0]) == pytest.approx(1.0, abs=0.3)


def test_tool_follows_the_reference(rig: Rig) -> None:
    target = moved(rig.advance(0.1).pose, x=-0.03, z=0.02)
    rig.arm.set_reference(target)
    state = rig.advance(1.0)
    assert state.pose.position == pytest.approx(target.position, abs=0.003)
    assert not state.stopped


def test_stamps_follow_the_clock_of_the_arm(rig: Rig) -> None:
    before = rig.advance(0.1).stamp
    assert 0.47 < rig.advance(0.5).stamp - before < 0.7  # a state that comes late is followed by more steps
    assert abs(rig.advance(0.1).stamp - rig.arm.now()) < 0.1


def test_wrench_is_that_of_the_environment_along_the_axes_of_the_base(rig: Rig) -> None:
    rig.arm.zero_sensor()
    rig.advance(0.1)
    rig.push((6.0, 0.0, -4.0), 3.0)
    assert rig.advance(1.5).wrench[:3] == pytest.approx((6.0, 0.0, -4.0), abs=0.5)


def test_commanded_wrench_moves_the_tool_along_its_axes_by_force_over_stiffness(rig: Rig) -> None:
    rig.arm.set_stiffness((400.0, 400.0, 400.0), (40.0, 40.0, 40.0))
    before = rig.advance(1.0).pose
    for _ in range(100):  # a driver may let a wrench expire
        rig.arm.set_wrench((0.0, 0.0, 8.0))
        after = rig.advance(0.1).pose
        if math.dist(before.position, after.position) > 7.5 / 400.0:
            break
    assert math.dist(before.position, after.position) == pytest.approx(8.0 / 400.0, abs=0.003)
    assert after.position[2] < before.position[2], "z points out of the hand, which is down"


def test_commanded_wrench_stays_while_the_state_is_read(rig: Rig) -> None:
    rig.arm.set_stiffness((400.0,) * 3, (40.0,) * 3)
    before = rig.advance(1.0).pose
    rig.arm.set_wrench((0.0, 0.0, 8.0))
    for _ in range(20):
        after = rig.advance(0.2).pose
    assert math.dist(before.position, after.position) == pytest.approx(8.0 / 400.0, abs=0.003)


def test_spiral_moves_the_tool_around_its_reference_and_back(rig: Rig) -> None:
    rig.arm.set_stiffness((1500.0,) * 3, (100.0,) * 3)
    centre = rig.advance(0.5).pose.position
    rig.arm.start_spiral(SpiralGoal(radius=0.01, path_distance=0.004, path_velocity=0.03))
    distances = [math.dist(rig.advance(0.1).pose.position, centre) for _ in range(30)]
    assert max(distances) == pytest.approx(0.01, abs=0.003)
    rig.arm.stop_overlay()
    assert math.dist(rig.advance(2.0).pose.position, centre) < 0.002


@pytest.mark.parametrize(("push", "way"), [(0.0, -1.0), (6.0, 0.0), (14.0, 1.0)])
def test_force_is_regulated_until_what_is_pressed_answers_it(rig: Rig, push: float, way: float) -> None:
    arm = rig.arm
    assert isinstance(arm, RegulatesForce)
    arm.zero_sensor()
    arm.set_stiffness((600.0, 600.0, 2000.0), (60.0,) * 3)
    start = rig.advance(0.1).pose
    arm.set_reference(start)
    arm.set_wrench_limits(40.0, 15.0)
    rig.push((0.0, 0.0, push), 4.0)
    arm.set_force_control(ForceGoal((0.0, 0.0, 6.0), speed=0.02))
    heights = []
    for _ in range(20):
        arm.set_reference(start)
        heights.append(rig.advance(0.1).pose.position[2])
    speed = (heights[-1] - heights[9]) / 1.0
    assert speed == pytest.approx(0.02 * way, abs=0.006)
    arm.set_force_control(None)
    arm.set_reference(start)
    rig.advance(3.0)
    assert rig.advance(0.1).pose.position == pytest.approx(start.position, abs=0.005), "it follows its reference again"


def test_force_control_ends_without_references(rig: Rig) -> None:
    if isinstance(rig.arm, SimulatedArm):
        pytest.skip("the driver ends with the process of the skill")
    assert isinstance(rig.arm, RegulatesForce)
    start = rig.advance(0.1).pose
    rig.arm.set_force_control(ForceGoal((0.0, 0.0, 6.0), speed=0.01))
    rig.advance(2.0)
    held = rig.advance(1.0).pose
    assert 0.005 < start.position[2] - held.position[2] < 0.02
    assert rig.advance(1.0).pose.position[2] == pytest.approx(held.position[2], abs=0.001)


def test_peak_of_the_force_between_states_is_kept_until_it_is_taken(rig: Rig) -> None:
    arm = rig.arm
    assert isinstance(arm, MeasuresPeak)
    arm.zero_sensor()
    arm.set_wrench_limits(100.0, 50.0)
    rig.advance(0.2)
    arm.take_peak()
    rig.push((20.0, 0.0, 0.0), 0.05)
    assert rig.advance(0.5).wrench[0] < 5.0, "the push is over"
    assert arm.take_peak() > 10.0, "it comes with the state"
    assert arm.take_peak() < 1.0


def test_exceeded_limit_stops_the_arm_with_the_reason_until_limits_are_set_again(rig: Rig) -> None:
    rig.arm.zero_sensor()
    rig.arm.set_wrench_limits(10.0, 5.0)
    assert not rig.advance(0.2).stopped
    rig.push((20.0, 0.0, 0.0), 0.2)
    stopped = rig.advance(1.0)
    assert "force" in stopped.stopped and "10" in stopped.stopped
    assert stopped.kind is FailureKind.LIMIT
    rig.arm.set_reference(moved(stopped.pose, x=-0.05))
    assert math.dist(rig.advance(1.0).pose.position, stopped.pose.position) < 0.02
    rig.arm.set_wrench_limits(30.0, 10.0)
    assert not rig.advance(0.2).stopped


def test_limit_of_one_axis_of_the_tool_stops_the_arm_until_limits_are_set_without_it(rig: Rig) -> None:
    """The tool points down, with its y axis along -y of the map."""
    rig.arm.zero_sensor()
    rig.arm.set_wrench_limits(60.0, 30.0, (0.0, 10.0, 0.0, 0.0, 0.0, 0.0))
    rig.advance(0.2)
    rig.push((20.0, 0.0, 0.0), 0.2)
    assert not rig.advance(1.0).stopped
    rig.push((0.0, 20.0, 0.0), 0.2)
    stopped = rig.advance(1.0)
    assert "along y above the limit of 10 N" in stopped.stopped
    assert stopped.kind is FailureKind.LIMIT
    rig.arm.set_wrench_limits(60.0, 30.0)
    rig.advance(0.2)
    rig.push((0.0, 20.0, 0.0), 0.2)
    assert not rig.advance(1.0).stopped


def test_begin_ends_a_stop_and_keeps_the_limits(rig: Rig) -> None:
    rig.arm.zero_sensor()
    rig.arm.set_wrench_limits(10.0, 5.0)
    for _ in range(2):
        rig.advance(0.5)
        rig.push((20.0, 0.0, 0.0), 0.2)
        assert "force" in rig.advance(1.0).stopped
        rig.arm.begin()
        assert not rig.advance(0.1).stopped


def test_end_leaves_the_arm_at_rest_where_it_is(rig: Rig) -> None:
    start = rig.advance(0.1).pose
    rig.arm.set_reference(moved(start, x=-0.10))
    rig.arm.set_wrench((0.0, 0.0, 10.0))
    rig.arm.start_spiral(SpiralGoal(radius=0.01, path_distance=0.004, path_velocity=0.03))
    rig.advance(0.1)
    rig.arm.end()
    rig.advance(0.1)  # until the driver has answered, which may take longer than simulated seconds
    there = rig.advance(1.5).pose
    assert math.dist(there.position, rig.advance(1.0).pose.position) < 0.001
    assert math.dist(there.position, start.position) < 0.09, "it does not go on to the reference"


@pytest.mark.parametrize(
    ("command", "problems"),
    [
        (lambda a: a.set_reference(Pose((math.nan, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0))), ["nan"]),
        (lambda a: a.set_reference(Pose((9.0, 0.0, 0.5), (1.0, 1.0, 0.0, 0.0))), ["up to 3 m", "unit quaternion"]),
        (lambda a: a.set_stiffness((2001.0, -1.0, 0.0), (0.0, 0.0, 0.0)), ["2001", "-1"]),
        (lambda a: a.set_damping((7.0,) * 6), ["damping factor 7"]),
        (lambda a: a.set_wrench((0.0, 0.0, 31.0)), ["wrench 31 of z"]),
        (lambda a: a.set_wrench_limits(-1.0, 5.0), ["expected 0 N"]),
        (lambda a: a.set_wrench_limits(1.0, 5.0, (1.0, 2.0)), ["along and about x, y, z"]),
        (lambda a: a.set_wrench_limits(1.0, 5.0, (math.nan,) * 6), ["along and about x, y, z"]),
    ],
)
def test_command_out_of_range_is_refused_with_all_problems(rig: Rig, command, problems: list[str]) -> None:  # type: ignore[no-untyped-def]
    before = rig.advance(0.5)
    with pytest.raises(WrongValue) as error:
        command(rig.arm)
    assert all(problem in str(error.value) for problem in problems)
    after = rig.advance(0.5)
    assert math.dist(before.pose.position, after.pose.position) < 0.002
    assert not after.stopped
