"""The controllers of a simulated arm: commands, overlay motion, trajectories, hand-guiding, limits, sensor, rate."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from skiros2_common.core.errors import Refused, WrongValue
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import Pose
from skiros2_motion.core.motion import State
from skiros2_motion.core.spiral import SpiralGoal
from skiros2_motion.core.wrench_guard import SENSOR_AGE, Limits
from skiros2_sim.core import reference_motion as codes
from skiros2_sim.core.cartesian_motion import FORCE_LIMIT
from skiros2_sim.core.joint_motion import PATH_TOLERANCE_VIOLATED, JointMotion
from skiros2_sim.core.reference_motion import ReferenceMotion, TrajectoryGoal
from skiros2_sim.core.world import World
from skiros2_sim.core.wrist_sensor import SensorModel
from support.moved_robot import DOWN, MovedRobot, succeeded
from support.simulated_cell import ARM, GRIPPER, ROBOT, TABLE_1, bench

#: Poses of the tool: in the air, and 3 cm above the table, beside the tray.
FREE = Pose((0.45, 0.2, 0.65), DOWN)
LOW = Pose((0.55, 0.3, 0.43), DOWN)
SPIRAL = SpiralGoal(radius=0.01, path_distance=0.004, path_velocity=0.03)
STIFF = (1500.0,) * 3 + (100.0,) * 3


@pytest.fixture(scope="module")
def contact_world() -> Iterator[World]:
    with World(bench(), rate=1000) as world:
        yield world


@pytest.fixture
def arm(contact_world: World) -> MovedRobot:
    """A compliant arm at 1000 steps per second, at rest in the air."""
    contact_world.reset(seed=0)
    robot = MovedRobot(contact_world)
    place(robot, FREE)
    return robot


@pytest.fixture
def stiff_arm(arm: MovedRobot) -> MovedRobot:
    """The same arm under position control."""
    arm.controller.switch("position")
    return arm


def place(robot: MovedRobot, tool: Pose) -> None:
    """Puts the arm at rest with its tool there; the compliant controller holds it."""
    robot.controller.switch("position")
    solution = robot.controller.kinematics.inverse(tool, np.array(robot.arm.rest))
    assert solution.converged
    for joint, position in zip(robot.arm.joints, solution.positions, strict=True):
        robot.world.physics.set_joint(robot.arm.body, joint.index, position)
    robot.controller.hold()
    robot.controller.switch("compliant")
    robot.world.step(200)


def moved(pose: Pose, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose((pose.position[0] + x, pose.position[1] + y, pose.position[2] + z), pose.orientation)


def trajectory(robot: MovedRobot, goal: Pose, **more: object) -> ReferenceMotion:
    return ReferenceMotion(robot.controller, TrajectoryGoal(goal, **more))  # type: ignore[arg-type]


def test_world_of_another_rate_keeps_the_time(contact_world: World) -> None:
    contact_world.reset(seed=0)
    contact_world.step(500)
    assert contact_world.time == pytest.approx(0.5)


@pytest.mark.parametrize("rate", [0, 100, 1_000_000])
def test_rate_out_of_range_is_refused(rate: int) -> None:
    with pytest.raises(WrongValue, match=f"rate {rate}: expected 240 to 2000"):
        World(bench(), rate=rate)


def test_law_runs_at_500_hz_in_a_world_of_1000_steps_per_second(arm: MovedRobot) -> None:
    arm.controller.set_reference(moved(arm.controller.tool_pose(), x=0.02))
    track = []
    for _ in range(100):
        arm.world.step()
        track.append(arm.controller.impedance.commanded_torques.copy())
    changes = [bool(np.any(a != b)) for a, b in itertools.pairwise(track)]
    assert sum(changes) in (49, 50)
    assert np.abs(np.diff(track, axis=0)).max() <= 2.0 + 1e-9, "1 Nm per ms"


def test_tool_follows_the_reference_and_holds_it_without_further_ones(arm: MovedRobot) -> None:
    target = moved(arm.controller.tool_pose(), x=0.03, z=-0.02)
    arm.controller.set_reference(target)
    arm.world.step(2000)
    assert distances(arm.controller.tool_pose(), target)[0] < 0.002
    arm.world.step(2000)
    assert distances(arm.controller.tool_pose(), target)[0] < 0.002
    assert max(map(abs, arm.arm.velocities())) < 0.005


@pytest.mark.parametrize(
    "command",
    [
        lambda c: c.set_reference(c.tool_pose()),
        lambda c: c.set_wrench((0.0,) * 6),
        lambda c: c.start_overlay(SPIRAL),
    ],
)
def test_inactive_controller_refuses_commands(arm: MovedRobot, command: Callable[..., None]) -> None:
    arm.controller.switch("position")
    with pytest.raises(Refused, match="controller compliant of arm arm is not active"):
        command(arm.controller)


@pytest.mark.parametrize("x", [math.nan, math.inf, 10.0])
def test_reference_out_of_range_changes_nothing(arm: MovedRobot, x: float) -> None:
    before = arm.controller.impedance.reference
    with pytest.raises(WrongValue, match="in the robot's frame: expected up to 3 m"):
        arm.controller.set_reference(Pose((x, 0.0, 0.5), before.orientation))
    arm.world.step(100)
    assert arm.controller.impedance.reference == before


def test_sensor_measures_a_push_in_the_tool_frame_without_the_weight_of_the_hand(arm: MovedRobot) -> None:
    at_rest = np.array(arm.arm.measured_wrench())
    assert np.linalg.norm(at_rest[:3]) < 0.3
    arm.world.push(GRIPPER, (0.0, 0.0, -8.0), duration=3.0)
    arm.world.step(2500)
    # the tool points down: a push down is along its z
    assert np.array(arm.arm.measured_wrench())[:3] - at_rest[:3] == pytest.approx([0.0, 0.0, 8.0], abs=0.3)


def test_zeroed_sensor_measures_no_bias() -> None:
    with World(bench(), sensor=SensorModel(bias=(3.0, 0.0, -2.0, 0.1, 0.0, 0.0))) as world:
        world.step(240)
        arm = world.arms[ARM]
        assert np.linalg.norm(arm.measured_wrench()[:3]) > 3.0
        assert arm.sensor is not None
        arm.zero_sensor()
        world.step(10)
        assert np.linalg.norm(arm.measured_wrench()) < 0.05


def test_noise_of_the_sensor_depends_on_the_seed_and_not_on_its_readers() -> None:
    def last(reads: int) -> tuple[float, ...]:
        with World(bench(), seed=4, sensor=SensorModel(force_noise=0.5, torque_noise=0.02)) as world:
            for _ in range(20):
                world.step()
                for _ in range(reads):
                    world.arms[ARM].measured_wrench()
            return world.arms[ARM].measured_wrench()

    assert last(0) == last(3)


def test_tool_moves_on_a_spiral_around_its_reference_and_back(arm: MovedRobot) -> None:
    arm.controller.stiffness = STIFF
    centre = np.array(arm.controller.tool_pose().position)
    arm.controller.start_overlay(SPIRAL)
    radii = []
    for _ in range(50):
        arm.world.step(50)
        radii.append(float(np.linalg.norm((np.array(arm.controller.tool_pose().position) - centre)[:2])))
    assert max(radii) == pytest.approx(0.01, abs=0.003)
    arm.controller.stop_overlay()
    arm.world.step(1500)
    assert arm.controller.overlay is None
    assert np.linalg.norm(np.array(arm.controller.tool_pose().position) - centre) < 0.001


def test_trajectory_arrives_with_progress_and_small_errors(arm: MovedRobot) -> None:
    arm.controller.stiffness = STIFF
    target = moved(arm.controller.tool_pose(), y=-0.1)
    motion = trajectory(arm, target, start=arm.controller.impedance.reference)
    seen = []
    succeeded(arm.run(motion, lambda: seen.append((motion.progress, *motion.errors()))))
    progress = [values[0] for values in seen]
    assert progress == sorted(progress)
    assert progress[-1] == 1.0
    assert max(values[1] for values in seen) < 0.02
    assert distances(arm.controller.tool_pose(), target)[0] < 0.005


def test_trajectory_against_the_table_violates_its_tolerance(arm: MovedRobot) -> None:
    place(arm, LOW)
    below = moved(arm.controller.tool_pose(), z=-0.06)
    outcome = arm.run(trajectory(arm, below, goal_time_tolerance=0.5))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.GOAL_TOLERANCE_VIOLATED)
    assert "m and" in outcome.text
    succeeded(arm.run(trajectory(arm, moved(below, z=-0.001), translational_tolerance=-1.0, rotational_tolerance=-1.0)))


def test_cancelled_trajectory_keeps_its_reference(arm: MovedRobot) -> None:
    target = moved(arm.controller.tool_pose(), y=-0.2)
    motion = trajectory(arm, target)
    arm.world.motions.add(motion)
    arm.world.step(1500)
    motion.cancel()
    arm.world.step(300)
    assert motion.outcome is not None
    assert (motion.outcome.state, motion.outcome.code) == (State.PREEMPTED, codes.PREEMPTED)
    before = arm.controller.tool_pose()
    arm.world.step(1000)
    assert distances(arm.controller.tool_pose(), before)[0] < 0.002
    assert distances(before, target)[0] > 0.03


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": math.nan}, "speed nan: expected a number from 0 to 1"),
        ({"speed": 9.0, "goal_time_tolerance": -1.0}, "speed 9.0.*; goal_time_tolerance -1.0"),
        ({"translational_tolerance": math.nan}, "translational_tolerance nan"),
        ({"start": Pose((0.4, 0.0, 0.9), (1.0, 0.0, 0.0, 0.0))}, "start is .* m and .* rad from the current reference"),
    ],
)
def test_invalid_trajectory_is_rejected(arm: MovedRobot, change: dict[str, object], said: str) -> None:
    motion = trajectory(arm, arm.controller.tool_pose(), **change)
    assert motion.outcome is not None
    assert (motion.outcome.state, motion.outcome.code) == (State.REJECTED, codes.INVALID_GOAL)
    with pytest.raises(AssertionError, match=said):
        succeeded(motion.outcome)


def test_force_limit_stops_the_arm_in_one_period_and_names_value_and_limit(arm: MovedRobot) -> None:
    place(arm, LOW)
    arm.controller.stiffness = STIFF
    assert arm.arm.sensor is not None
    arm.controller.set_limits(20.0, 0.0)
    arm.controller.start_overlay(SPIRAL)
    arm.controller.set_wrench((0.0, 0.0, 5.0, 0.0, 0.0, 0.0))
    over = []

    def watch() -> None:
        if not over and np.linalg.norm(arm.arm.measured_wrench()[:3]) > 20.0:
            over.append(arm.world.time)

    outcome = arm.run(trajectory(arm, moved(arm.controller.tool_pose(), z=-0.08), speed=0.02), watch)
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.FORCE_LIMIT)
    stop = arm.controller.stop
    assert stop is not None
    assert (stop.quantity, stop.limit) == ("force", 20.0)
    assert 20.0 < stop.value < 24.0
    assert stop.time - over[0] < 0.0025, "a control period and a rounding error"
    assert f"force of {stop.value:.1f} N above the limit of 20 N" in outcome.text
    assert arm.controller.overlay is None
    peak = 0.0
    for _ in range(500):
        arm.world.step()
        peak = max(peak, float(np.linalg.norm(arm.arm.measured_wrench()[:3])))
    assert peak < 24.0
    assert np.linalg.norm(arm.arm.measured_wrench()[:3]) < 10.0
    assert arm.controller.impedance.wrench == pytest.approx(0.0)


@pytest.mark.parametrize("wait", [0, 1])
def test_impact_of_a_single_step_does_not_stop_the_arm(arm: MovedRobot, wait: int) -> None:
    arm.controller.set_limits(20.0, 0.0)
    arm.world.step(wait)
    arm.world.push(GRIPPER, (100.0, 0.0, 0.0), duration=1.0 / arm.world.rate)
    felt = []
    for _ in range(20):
        arm.world.step()
        felt.append(float(np.linalg.norm(arm.arm.measured_wrench()[:3])))
    assert max(felt) > 20.0
    assert arm.controller.stop is None


def test_stopped_arm_refuses_commands_until_its_limits_are_set_again(arm: MovedRobot) -> None:
    arm.controller.set_limits(3.0, 0.0)
    arm.world.push(GRIPPER, (6.0, 0.0, 0.0), duration=0.3)
    arm.world.step(500)
    assert arm.controller.stop is not None
    with pytest.raises(Refused, match=r"stopped at a force of .* above the limit of 3 N; set its limits again"):
        arm.controller.set_reference(arm.controller.tool_pose())
    straight = arm.run(arm.line(FREE.position))
    assert straight.state is State.ABORTED
    arm.controller.set_limits(30.0, 0.0)
    arm.controller.set_reference(arm.controller.tool_pose())


@pytest.mark.parametrize("limits", [(-1.0, 0.0), (math.nan, 0.0), (0.0, math.inf)])
def test_invalid_limits_are_refused(arm: MovedRobot, limits: tuple[float, float]) -> None:
    with pytest.raises(WrongValue, match="limits of force and torque"):
        arm.controller.set_limits(*limits)
    assert arm.controller.limits == Limits()


def test_guided_arm_follows_a_hand_and_stays_where_it_is_left(arm: MovedRobot) -> None:
    arm.controller.stiffness = (0.0,) * 6
    before = arm.controller.tool_pose()
    arm.world.step(1000)
    assert distances(arm.controller.tool_pose(), before)[0] < 0.001, "gravity is compensated"
    arm.world.push(GRIPPER, (10.0, 0.0, 5.0), duration=0.5)
    arm.world.step(2500)
    left = arm.controller.tool_pose()
    assert left.position[0] - before.position[0] > 0.1
    arm.world.step(1000)
    assert distances(arm.controller.tool_pose(), left)[0] < 0.002, "no drift"
    arm.controller.stiffness = STIFF
    arm.world.step(1000)
    assert distances(arm.controller.tool_pose(), left)[0] < 0.002, "no jump back to the old reference"


def test_trajectory_of_a_guided_arm_is_rejected(arm: MovedRobot) -> None:
    arm.controller.stiffness = (0.0,) * 6
    motion = trajectory(arm, arm.controller.tool_pose())
    assert motion.outcome is not None
    assert (motion.outcome.state, motion.outcome.code) == (State.REJECTED, codes.INVALID_GOAL)
    assert "the stiffness is 0 in all directions" in motion.outcome.text


def test_wrench_that_is_not_set_again_expires(arm: MovedRobot, caplog: pytest.LogCaptureFixture) -> None:
    start = arm.controller.tool_pose()
    for _ in range(4):
        arm.controller.set_wrench((0.0, 0.0, 10.0, 0.0, 0.0, 0.0), timeout=0.5)
        arm.world.step(300)
    assert arm.controller.impedance.wrench[2] == pytest.approx(10.0, abs=0.1)
    assert not caplog.records
    arm.world.step(1500)
    assert arm.controller.impedance.wrench == pytest.approx(0.0, abs=0.01)
    assert distances(arm.controller.tool_pose(), start)[0] < 0.002
    assert [record.message for record in caplog.records] == [
        "arm arm: the commanded wrench was not set again in time: it is 0 now"
    ]


def test_wrench_that_was_set_to_zero_does_not_expire(arm: MovedRobot, caplog: pytest.LogCaptureFixture) -> None:
    for force in (10.0, 0.0):
        arm.controller.set_wrench((0.0, 0.0, force, 0.0, 0.0, 0.0), timeout=0.5)
        arm.world.step(300)
    arm.world.step(700)
    assert not caplog.records


def test_wrench_without_a_timeout_holds(arm: MovedRobot) -> None:
    arm.controller.set_wrench((0.0, 0.0, 10.0, 0.0, 0.0, 0.0))
    arm.world.step(2000)
    assert arm.controller.impedance.wrench[2] == pytest.approx(10.0, abs=0.1)


def test_silent_sensor_stops_a_limited_arm_which_its_motors_then_hold(arm: MovedRobot) -> None:
    arm.controller.set_limits(20.0, 5.0)
    motion = trajectory(arm, moved(arm.controller.tool_pose(), y=-0.2))
    arm.controller.set_wrench((0.0, 0.0, 5.0, 0.0, 0.0, 0.0))
    arm.world.motions.add(motion)
    arm.world.step(1000)
    arm.world.faults.set("silent_sensor", ARM)
    arm.world.step(50)
    assert motion.outcome is not None
    assert (motion.outcome.state, motion.outcome.code) == (State.ABORTED, codes.STALE_SENSOR)
    assert "stopped at a sensor age of 0.022 s above the limit of 0.02 s" in motion.outcome.text
    assert arm.controller.stop is not None
    assert arm.controller.stop.quantity == SENSOR_AGE
    arm.world.step(500)
    at_rest = arm.controller.tool_pose()
    assert arm.controller.impedance.wrench == pytest.approx(0.0)
    arm.world.push(GRIPPER, (10.0, 0.0, 0.0), duration=0.5)
    arm.world.step(450)
    assert distances(arm.controller.tool_pose(), at_rest)[0] < 0.0005
    arm.controller.set_limits(20.0, 5.0)
    arm.world.step(2)
    assert arm.controller.stop is not None, "still without a measurement"
    arm.world.faults.clear("silent_sensor", ARM)
    arm.controller.set_limits(20.0, 5.0)
    arm.controller.set_reference(arm.controller.tool_pose())


def test_silent_sensor_does_not_stop_an_arm_without_limits(arm: MovedRobot) -> None:
    arm.world.faults.set("silent_sensor", ARM)
    succeeded(arm.run(trajectory(arm, moved(arm.controller.tool_pose(), y=-0.02))))
    assert arm.controller.stop is None


def joint_motion(robot: MovedRobot, tool: Pose, time: float) -> JointMotion:
    solution = robot.controller.kinematics.inverse(tool, np.array(robot.arm.positions()))
    assert solution.converged
    return robot.trajectory(solution.positions.tolist(), time)


def test_limits_under_position_control_abort_a_trajectory_with_the_reason(arm: MovedRobot) -> None:
    place(arm, LOW)
    arm.controller.switch("position")
    arm.controller.set_position_limits(25.0, 0.0)
    outcome = arm.run(joint_motion(arm, moved(LOW, z=-0.06), time=3.0))
    assert (outcome.state, outcome.code) == (State.ABORTED, PATH_TOLERANCE_VIOLATED)
    assert "stopped at a force of" in outcome.text
    assert f"above the limit of 25 N, it touches {TABLE_1}" in outcome.text
    assert np.linalg.norm(arm.arm.measured_wrench()[:3]) < 25.0, "it has retreated"
    again = joint_motion(arm, FREE, time=3.0)
    assert again.outcome is not None
    assert again.outcome.state is State.REJECTED
    assert "set its limits again to move it" in again.outcome.text
    line = arm.run(arm.line(FREE.position))
    assert (line.state, line.code) == (State.ABORTED, FORCE_LIMIT)
    arm.controller.set_position_limits(0.0, 0.0)
    succeeded(arm.run(joint_motion(arm, FREE, time=2.0)))


def test_silent_sensor_stops_a_limited_trajectory_under_position_control(stiff_arm: MovedRobot) -> None:
    stiff_arm.controller.set_position_limits(50.0, 0.0)
    motion = joint_motion(stiff_arm, moved(FREE, y=-0.2), time=2.0)
    stiff_arm.world.motions.add(motion)
    stiff_arm.world.step(500)
    assert motion.outcome is None
    stiff_arm.world.faults.set("silent_sensor", ARM)
    stiff_arm.world.step(50)
    assert motion.outcome is not None
    assert "sensor age" in motion.outcome.text
    stopped = stiff_arm.controller.tool_pose()
    stiff_arm.world.step(300)
    assert distances(stiff_arm.controller.tool_pose(), stopped)[0] < 0.003


def test_limits_of_one_controller_do_not_hold_for_the_other(arm: MovedRobot) -> None:
    arm.controller.set_limits(3.0, 0.0)
    arm.controller.switch("position")
    arm.world.push(GRIPPER, (6.0, 0.0, 0.0), duration=0.2)
    arm.world.step(200)
    assert arm.controller.stop is None
    arm.controller.set_position_limits(3.0, 0.0)
    arm.controller.set_limits(0.0, 0.0)
    arm.controller.switch("compliant")
    arm.world.push(GRIPPER, (6.0, 0.0, 0.0), duration=0.2)
    arm.world.step(200)
    assert arm.controller.stop is None


@pytest.mark.parametrize("limits", [(-1.0, 0.0), (math.nan, 0.0), (0.0, math.inf)])
def test_invalid_position_limits_are_refused(stiff_arm: MovedRobot, limits: tuple[float, float]) -> None:
    with pytest.raises(WrongValue, match="limits of force and torque"):
        stiff_arm.controller.set_position_limits(*limits)
    assert stiff_arm.controller.position_limits == Limits()


def test_runs_with_one_seed_are_identical() -> None:
    def final() -> tuple[float, ...]:
        with World(bench(), seed=3, rate=1000, sensor=SensorModel(0.2, 0.01)) as world:
            robot = MovedRobot(world)
            robot.controller.switch("compliant")
            robot.controller.set_limits(40.0, 10.0)
            robot.controller.start_overlay(dataclasses.replace(SPIRAL, allow_decrease=True))
            world.step(700)
            return (*robot.arm.positions(), *robot.arm.measured_wrench())

    assert final() == final()


def test_reset_world_keeps_the_robot(arm: MovedRobot) -> None:
    arm.world.reset()
    assert arm.world.robots[ROBOT].arms[ARM].sensor is not None
