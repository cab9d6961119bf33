"""Adapters of `CompliantArm` to the controllers of franka_ros, FZI and Mayr, with stand-ins of these drivers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.ros.profiles import PROFILES
from skiros2_contact_skills.ros.topic_arm import TopicArm
from skiros2_motion.core.arm_abilities import Described
from skiros2_motion.core.compliant_arm import ArmState, KeepsStates
from skiros2_motion.core.force_control import ForceGoal
from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_motion.core.regions import Region
from skiros2_motion.core.spiral import SpiralGoal
from support.ros import Ros, RosMaster, wait_until
from support.stand_in_controllers import (
    REFLEX,
    CartesianControllers,
    CartesianImpedance,
    FrankaRos,
    StandIn,
    other_packages,
)

pytestmark = pytest.mark.timeout(120)

WAIT = 30.0
DRIVERS = {
    "franka_ros": FrankaRos,
    "cartesian_controllers": CartesianControllers,
    "cartesian_impedance_controller": CartesianImpedance,
}


class Rig:
    """An adapter and its driver."""

    def __init__(self, profile: str) -> None:
        self.driver: StandIn = DRIVERS[profile]()
        names = {"compliant": self.driver.controller_name, "position": "position_joint_trajectory_controller"}
        self.arm = TopicArm(PROFILES[profile], names)

    def close(self) -> None:
        self.arm.close()
        self.driver.close()

    def wait_for(self, condition: Callable[[ArmState], object]) -> ArmState:
        """Ticks until the state is as wanted."""

        def state() -> ArmState | None:
            found = self.arm.state()
            return found if found is not None and condition(found) else None

        return wait_until(state, WAIT, "a state as wanted")

    def at_rest(self) -> ArmState:
        """The state when the tool does not move any more."""
        last = [self.wait_for(lambda s: True)]

        def still(state: ArmState) -> bool:
            if state.stamp < last[-1].stamp + 0.3:
                return False
            last.append(state)
            return math.dist(last[-1].pose.position, last[-2].pose.position) < 0.0005

        return self.wait_for(still)


@pytest.fixture(scope="module")
def ros(ros_master: RosMaster) -> Iterator[Ros]:
    system = Ros(ros_master)
    with other_packages():
        yield system
    system.stop()


@pytest.fixture(params=["franka_ros", *(pytest.param(name, marks=pytest.mark.long) for name in list(DRIVERS)[1:])])
def rig(ros: Ros, request: pytest.FixtureRequest) -> Iterator[Rig]:
    yield from begun(request.param)


@pytest.fixture
def franka(ros: Ros) -> Iterator[Rig]:
    yield from begun("franka_ros")


@pytest.fixture
def fzi(ros: Ros) -> Iterator[Rig]:
    yield from begun("cartesian_controllers")


@pytest.fixture
def mayr(ros: Ros) -> Iterator[Rig]:
    yield from begun("cartesian_impedance_controller")


def begun(profile: str) -> Iterator[Rig]:
    rig = Rig(profile)
    try:
        rig.arm.begin()
        rig.arm.set_stiffness((400.0,) * 3, (30.0,) * 3)
        rig.wait_for(lambda s: not s.stopped)
        yield rig
    finally:
        rig.close()


def moved(pose: Pose, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose((pose.position[0] + x, pose.position[1] + y, pose.position[2] + z), pose.orientation)


def test_tool_follows_the_reference_on_the_base_of_the_arm(rig: Rig) -> None:
    assert rig.driver.running == rig.driver.controller_name
    target = moved(rig.at_rest().pose, x=-0.04, z=0.03)
    rig.arm.set_reference(target)
    rig.wait_for(lambda s: math.dist(s.pose.position, target.position) < 0.004)
    assert rig.driver.references[-1].header.frame_id in ("panda_link0", "base_link")


def test_wrench_is_that_of_the_environment_about_the_tool_along_the_axes_of_the_base(rig: Rig) -> None:
    rig.at_rest()
    rig.arm.zero_sensor()
    rig.wait_for(lambda s: math.hypot(*s.wrench[:3]) < 0.5)
    rig.driver.push(6.0, 0.0, -4.0, 10.0)
    state = rig.wait_for(
        lambda s: abs(s.wrench[0] - 6.0) < 0.5 and abs(s.wrench[1]) < 0.5 and abs(s.wrench[2] + 4.0) < 0.5
    )
    assert math.hypot(*state.wrench[3:]) < 1.0, "the hand is pushed near the tool"


def test_commanded_wrench_moves_the_tool_by_force_over_stiffness(rig: Rig) -> None:
    start = rig.at_rest().pose
    rig.arm.set_reference(start)
    rig.arm.set_wrench((0.0, 0.0, 8.0))
    state = rig.wait_for(lambda s: start.position[2] - s.pose.position[2] > 0.9 * 8.0 / 400.0)
    assert math.dist(state.pose.position, start.position) < 1.3 * 8.0 / 400.0


def test_spiral_moves_the_tool_around_its_reference_and_back(rig: Rig) -> None:
    start = rig.at_rest().pose
    rig.arm.set_reference(start)
    rig.arm.start_spiral(SpiralGoal(radius=0.02, path_distance=0.008, path_velocity=0.03))
    rig.wait_for(lambda s: math.dist(s.pose.position, start.position) > 0.01)
    rig.arm.stop_overlay()
    assert math.dist(rig.at_rest().pose.position, start.position) < 0.005


def test_exceeded_limit_holds_the_arm_until_limits_are_set_again(rig: Rig) -> None:
    rig.at_rest()
    rig.arm.zero_sensor()
    rig.arm.set_wrench_limits(10.0, 5.0)
    rig.driver.push(20.0, 0.0, 0.0, 0.3)
    stopped = rig.wait_for(lambda s: s.stopped)
    assert stopped.stopped.startswith("force of") and stopped.stopped.endswith("above the limit of 10 N")
    rig.arm.set_reference(moved(stopped.pose, x=-0.2))
    held = rig.at_rest()
    assert held.stopped
    assert math.dist(held.pose.position, stopped.pose.position) < 0.06
    rig.arm.set_wrench_limits(60.0, 20.0)
    rig.wait_for(lambda s: not s.stopped)


def limited_at_rest(rig: Rig) -> ArmState:
    rig.at_rest()
    rig.arm.zero_sensor()
    rig.arm.set_wrench_limits(40.0, 15.0)
    rig.arm.set_reference(rig.at_rest().pose)
    return rig.at_rest()


@pytest.mark.parametrize("number", range(6))
def test_wrench_with_a_number_that_is_not_finite_stops_the_arm_at_its_last_pose(rig: Rig, number: int) -> None:
    start = limited_at_rest(rig)
    rig.driver.distort = lambda wrench: [math.nan if i == number else value for i, value in enumerate(wrench)]
    stopped = rig.wait_for(lambda s: s.stopped)
    assert stopped.kind is FailureKind.SENSOR
    assert "not finite" in stopped.stopped
    rig.driver.distort = lambda wrench: wrench
    rig.arm.set_reference(moved(start.pose, x=-0.1))
    held = rig.at_rest()
    assert held.stopped, "until limits are set again"
    assert math.dist(held.pose.position, start.pose.position) < 0.01


def test_pose_with_a_number_that_is_not_finite_stops_the_arm_at_its_last_pose(franka: Rig) -> None:
    limited_at_rest(franka)
    franka.driver.distort_pose = lambda pose: Pose((pose.position[0], math.nan, pose.position[2]), pose.orientation)
    stopped = franka.wait_for(lambda s: s.stopped)
    assert stopped.kind is FailureKind.SENSOR
    assert all(map(math.isfinite, stopped.pose.position))
    p = franka.driver.references[-1].pose.position
    assert all(map(math.isfinite, (p.x, p.y, p.z)))


@pytest.mark.parametrize("values", [(0.0,) * 6, (0.3, -0.1, 2.0, 0.0, 0.1, 0.0)])
def test_frozen_sensor_stops_the_arm(rig: Rig, values: tuple[float, ...]) -> None:
    limited_at_rest(rig)
    rig.driver.distort = lambda wrench: values
    stopped = rig.wait_for(lambda s: s.stopped)
    assert stopped.kind is FailureKind.SENSOR
    assert "without a change" in stopped.stopped


def test_reference_that_is_sent_leads_by_the_limit_over_the_stiffness_only(rig: Rig) -> None:
    start = limited_at_rest(rig)
    rig.arm.set_wrench_limits(12.0, 5.0)
    rig.arm.set_reference(moved(start.pose, x=-0.15))
    sent = len(rig.driver.references)
    rig.wait_for(lambda s: len(rig.driver.references) > sent)
    p = rig.driver.references[sent].pose.position
    assert math.dist((p.x, p.y, p.z), start.pose.position) == pytest.approx(12.0 / 400.0, abs=0.003)
    rig.wait_for(lambda s: math.dist(s.pose.position, start.pose.position) > 0.12)


def test_stiff_driver_whose_sensor_is_silent_is_held_where_the_tool_was_seen_last(fzi: Rig) -> None:
    start = limited_at_rest(fzi)
    fzi.arm.set_wrench((0.0, 0.0, 5.0))
    fzi.arm.set_reference(moved(start.pose, z=0.1))
    fzi.wait_for(lambda s: s.pose.position[2] > start.pose.position[2] + 0.02)
    fzi.driver.is_silent = True

    def is_held(state: ArmState) -> bool:
        p, wrench = fzi.driver.references[-1].pose.position, fzi.driver.wrenches[-1].wrench
        return math.dist((p.x, p.y, p.z), state.pose.position) < 1e-6 and wrench.force.z == 0.0

    fzi.wait_for(lambda s: not s.stopped and is_held(s))
    fzi.driver.is_silent = False
    fzi.wait_for(lambda s: fzi.driver.wrenches[-1].wrench.force.z == 5.0 and not is_held(s))


def test_stiff_driver_with_a_sensor_without_noise_is_refused(ros: Ros) -> None:
    names = {"compliant": "compliance", "position": "position", "sensor": "exact"}
    with pytest.raises(ConfigurationError, match="needs one that is noisy"):
        TopicArm(PROFILES["cartesian_controllers"], names)


def test_driver_that_stops_publishing_is_reported(rig: Rig) -> None:
    rig.driver.is_silent = True
    state = rig.wait_for(lambda s: s.stopped)
    assert state.stopped.startswith("no /")


def test_controller_that_does_not_run_is_reported_with_those_that_exist(rig: Rig) -> None:
    rig.driver.running, rig.driver.can_switch = "", False
    rig.arm.begin()
    state = rig.wait_for(lambda s: s.stopped)
    name = rig.driver.controller_name
    assert f"controller {name} does not run" in state.stopped
    assert f"{name} (stopped)" in state.stopped


def test_controller_that_somebody_switches_off_is_reported(rig: Rig) -> None:
    rig.driver.running = ""
    state = rig.wait_for(lambda s: s.stopped)
    assert state.stopped == f"controller {rig.driver.controller_name} is not active"
    assert state.kind is FailureKind.CONTROLLER


def test_next_skill_of_a_task_does_not_take_back_a_controller(rig: Rig) -> None:
    rig.arm.end()
    rig.driver.running = ""
    rig.arm.resume()
    state = rig.wait_for(lambda s: s.stopped)
    assert (state.kind, rig.driver.running) == (FailureKind.CONTROLLER, "")
    rig.arm.begin()
    rig.wait_for(lambda s: not s.stopped)
    rig.arm.resume()
    rig.wait_for(lambda s: not s.stopped)


def test_end_leaves_the_arm_at_rest_without_a_wrench(rig: Rig) -> None:
    start = rig.at_rest().pose
    rig.arm.set_reference(moved(start, x=-0.1))
    rig.arm.set_wrench((0.0, 0.0, 10.0))
    rig.arm.end()
    there = rig.at_rest().pose
    assert math.dist(there.position, start.position) < 0.06


def test_reflex_of_a_franka_arm_has_its_errors_and_begin_recovers(franka: Rig) -> None:
    assert isinstance(franka.driver, FrankaRos)
    franka.driver.mode = REFLEX
    state = franka.wait_for(lambda s: s.stopped)
    assert state.stopped == "reflex: cartesian_reflex"
    franka.arm.begin()
    franka.wait_for(lambda s: not s.stopped)


def test_stiffness_of_a_franka_arm_is_the_least_of_its_axes(franka: Rig) -> None:
    franka.arm.set_stiffness((300.0, 200.0, 2000.0), (100.0, 20.0, 60.0))
    wait_until(lambda: franka.driver.arm.stiffness == (200.0,) * 3 + (20.0,) * 3, WAIT, "the stiffness")


def test_wrench_is_sent_again_to_a_controller_that_takes_one(fzi: Rig) -> None:
    fzi.arm.set_wrench((0.0, 0.0, 3.0))
    fzi.wait_for(lambda s: len(fzi.driver.wrenches) >= 3)
    assert {message.wrench.force.z for message in fzi.driver.wrenches} == {3.0}
    assert fzi.driver.wrenches[-1].header.frame_id == "tool0"


def test_stiffness_and_damping_of_a_controller_with_topics_are_sent_in_its_messages_and_limits(mayr: Rig) -> None:
    mayr.at_rest()
    driver = mayr.driver
    assert isinstance(driver, CartesianImpedance)
    mayr.arm.set_stiffness((300.0, 300.0, 2000.0), (20.0, 20.0, 300.0))
    mayr.arm.set_damping((1.5, 1.5, 6.0, 1.5, 1.5, 1.5))
    wait_until(lambda: driver.dampings, WAIT, "damping factors")
    assert driver.dampings[-1].force.x == pytest.approx(1.5)
    assert driver.dampings[-1].force.z == pytest.approx(2.0), "its maximum"
    wait_until(lambda: driver.stiffnesses[-1].wrench.force.z > 1000.0, WAIT, "the stiffness, on a topic of its own")
    sent = driver.stiffnesses[-1].wrench
    assert (sent.force.z, sent.torque.z) == pytest.approx((1500.0, 100.0), rel=0.02), "its maxima, along the base"


def test_abilities_have_the_measured_period_of_the_state_and_what_the_driver_lacks(rig: Rig) -> None:
    assert isinstance(rig.arm, Described)
    rig.wait_for(lambda s: True)
    abilities = rig.arm.abilities()
    assert 0.02 < abilities.state_period < 0.2, "30 Hz, on a busy machine"
    assert abilities.reaction_time == abilities.state_period, "the adapter checks the limits at each state"
    assert abilities.added_force(0.1, 800.0) == pytest.approx(80.0 * abilities.state_period)
    assert abilities.wrench == (not isinstance(rig.driver, FrankaRos))
    assert abilities.damping == isinstance(rig.driver, CartesianImpedance)


def test_states_between_two_ticks_are_kept(rig: Rig) -> None:
    start = rig.at_rest()
    assert isinstance(rig.arm, KeepsStates)
    rig.arm.take_states()
    end = rig.wait_for(lambda s: s.stamp > start.stamp + 1.0)
    stamps = [state.stamp for state in rig.arm.take_states()]
    assert len(stamps) > 2, "30 Hz, on a busy machine"
    assert stamps == sorted(stamps)
    assert stamps[-1] >= end.stamp


def test_reference_behind_a_region_stops_before_it(rig: Rig) -> None:
    start = rig.at_rest().pose
    x, y, z = start.position
    behind = Pose((x - 0.06, y, z), from_euler(0.0, math.pi / 2.0, 0.0))  # what is beyond x - 0.06
    rig.arm.set_regions([Region("wall", behind)])
    rig.arm.set_reference(moved(start, x=-0.12))
    rig.wait_for(lambda s: s.pose.position[0] < x - 0.02)
    held = rig.at_rest().pose.position[0]
    assert x - 0.045 < held < x - 0.02
    rig.arm.set_regions([])
    rig.arm.set_reference(moved(start, x=-0.12))
    rig.wait_for(lambda s: s.pose.position[0] < x - 0.1)


def test_adapter_regulates_the_force_at_the_rate_that_it_says(rig: Rig) -> None:
    start = limited_at_rest(rig)
    assert 5.0 < rig.arm.abilities().force_rate < 40.0, "30 Hz, on a busy machine"
    for push, is_lower in ((0.0, True), (14.0, False)):
        rig.driver.push(0.0, 0.0, push, 20.0)
        before = rig.wait_for(lambda s: True).pose.position[2]
        rig.arm.set_force_control(ForceGoal((0.0, 0.0, 6.0), speed=0.02))

        def has_moved(state: ArmState, before: float = before, is_lower: bool = is_lower) -> bool:
            rig.arm.set_reference(start.pose)
            way = state.pose.position[2] - before
            return way < -0.01 if is_lower else way > 0.01

        rig.wait_for(has_moved)
    assert rig.arm.take_peak() > 10.0


def test_sensor_without_a_transform_is_reported(ros: Ros) -> None:
    driver = CartesianControllers()
    names = {"compliant": driver.controller_name, "position": "position", "base_frame": "another_base"}
    arm = TopicArm(PROFILES["cartesian_controllers"], names)
    try:
        arm.begin()
        state = wait_until(lambda: (s := arm.state()) and s.stopped and s, WAIT, "a reason")
        assert "tf has no transform from another_base to tool0" in state.stopped
    finally:
        arm.close()
        driver.close()
