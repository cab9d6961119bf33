"""A simulated arm whose sensors fail: it stops, it comes to rest, and no contact is above the limit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from skiros2_common.core.errors import Refused, WrongValue
from skiros2_motion.core import wrench_guard as guard
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import Pose
from skiros2_sim.core.physics import JointState
from skiros2_sim.core.world import World
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel
from support.moved_robot import DOWN, MovedRobot
from support.simulated_cell import ARM, GRIPPER, bench

LOW = Pose((0.55, 0.3, 0.43), DOWN)
STIFF = (1500.0,) * 3 + (100.0,) * 3
#: Noise of a usual sensor at a wrist.
NOISY = SensorModel(force_noise=0.1, torque_noise=0.005)
LIMIT = 30.0


def robot_in(world: World) -> MovedRobot:
    """A compliant arm at rest, 3 cm above the table."""
    robot = MovedRobot(world)
    solution = robot.controller.kinematics.inverse(LOW, np.array(robot.arm.rest))
    for joint, position in zip(robot.arm.joints, solution.positions, strict=True):
        world.physics.set_joint(robot.arm.body, joint.index, position)
    robot.controller.hold()
    robot.controller.switch("compliant")
    world.step(200)
    robot.controller.zero_sensor()
    robot.controller.set_limits(LIMIT, 10.0)
    robot.controller.stiffness = STIFF
    return robot


@pytest.fixture(scope="module", params=[EXACT, NOISY], ids=["exact", "noisy"])
def world(request: pytest.FixtureRequest) -> Iterator[World]:
    with World(bench(), rate=1000, sensor=request.param) as world:
        yield world


@pytest.fixture
def arm(world: World) -> MovedRobot:
    world.reset(seed=0)
    return robot_in(world)


def true_force(arm: MovedRobot) -> float:
    """The force of all contacts with the hand (N)."""
    return math.hypot(*arm.arm.wrench()[:3])


def press(arm: MovedRobot, seconds: float) -> float:
    """Lowers the reference to 5 cm below the table; returns the largest force of the contacts (N)."""
    start, peak = arm.controller.tool_pose(), 0.0
    steps = round(seconds * arm.world.rate)
    for i in range(steps):
        if arm.controller.stop is None and i % 10 == 0:
            x, y, z = start.position
            arm.controller.set_reference(Pose((x, y, z - 0.08 * i / steps), start.orientation))
        arm.world.step()
        peak = max(peak, true_force(arm))
    return peak


def speed(arm: MovedRobot) -> float:
    return max(map(abs, arm.arm.velocities()))


@pytest.mark.parametrize("number", range(1, 7))
def test_wrench_with_a_component_that_is_not_finite_stops_the_arm(arm: MovedRobot, number: int) -> None:
    arm.world.faults.set("nan_sensor", ARM, number)
    arm.world.step(3)
    assert arm.controller.stop is not None
    assert arm.controller.stop.quantity == guard.NOT_FINITE


@pytest.mark.parametrize("fault", ["nan_sensor", "zero_sensor", "frozen_sensor", "silent_sensor", "late_sensor"])
def test_arm_whose_sensor_fails_presses_with_less_than_the_limit(arm: MovedRobot, fault: str) -> None:
    arm.world.faults.set(fault, ARM)
    peak = press(arm, 3.0)
    assert peak < 1.2 * LIMIT
    assert arm.controller.stop is not None, "a sensor that disagrees with the commanded force is found"
    assert speed(arm) < 0.02


def test_noisy_sensor_that_freezes_in_the_air_stops_the_arm_at_once() -> None:
    with World(bench(), rate=1000, sensor=NOISY) as world:
        arm = robot_in(world)
        world.step(500)
        assert arm.controller.stop is None
        world.faults.set("frozen_sensor", ARM)
        world.step(60)
        assert arm.controller.stop is not None
        assert arm.controller.stop.quantity == guard.FROZEN


@pytest.mark.parametrize("fault", ["zero_sensor", "frozen_sensor"])
def test_exact_sensor_that_freezes_during_a_motion_stops_the_arm_at_once(fault: str) -> None:
    with World(bench(), rate=1000, sensor=EXACT) as world:
        arm = robot_in(world)
        x, y, z = arm.controller.tool_pose().position
        arm.controller.set_reference(Pose((x, y, z + 0.05), DOWN))
        world.step(100)
        world.faults.set(fault, ARM)
        world.step(80)
        assert arm.controller.stop is not None
        assert arm.controller.stop.quantity == guard.FROZEN


def test_exact_sensor_that_freezes_in_a_contact_stops_the_arm_that_presses_more() -> None:
    with World(bench(), rate=1000, sensor=EXACT) as world:
        arm = robot_in(world)
        x, y, z = arm.controller.tool_pose().position
        for i in range(100):
            arm.controller.set_reference(Pose((x, y, z - 0.0004 * i), DOWN))
            world.step(10)
        world.step(300)
        assert true_force(arm) > 3.0
        world.faults.set("frozen_sensor", ARM)
        world.step(100)
        assert arm.controller.stop is None, "nothing shows it while the arm rests"
        arm.controller.set_reference(Pose((x, y, z - 0.05), DOWN))
        world.step(100)
        assert arm.controller.stop is not None
        assert arm.controller.stop.quantity == guard.FROZEN


def test_working_sensor_gives_no_false_alarm(arm: MovedRobot) -> None:
    start = arm.controller.tool_pose()
    x, y, z = start.position
    for dx, dz in ((0.0, 0.0), (0.1, 0.1), (-0.1, 0.2), (0.0, 0.0)):
        arm.controller.set_reference(Pose((x + dx, y, z + dz), start.orientation))
        arm.world.step(1500)
        assert arm.controller.stop is None, str(arm.controller.stop)
    arm.world.push(GRIPPER, (15.0, 0.0, 10.0), duration=1.0)
    arm.world.step(2000)
    assert arm.controller.stop is None, str(arm.controller.stop)


def test_carried_object_is_no_disagreement(arm: MovedRobot) -> None:
    arm.world.push(GRIPPER, (0.0, 0.0, -25.0), duration=6.0)
    arm.world.step(2000)
    assert arm.controller.stop is None, str(arm.controller.stop)
    assert arm.arm.sensor is not None
    arm.controller.payload.carry()
    arm.world.step(2000)
    assert arm.controller.stop is None, str(arm.controller.stop)


@pytest.mark.parametrize("quantity", ["position", "velocity"])
@pytest.mark.parametrize("joint", [0, 6])
def test_joint_state_that_is_not_finite_stops_the_arm_where_it_is(
    arm: MovedRobot, monkeypatch: pytest.MonkeyPatch, quantity: str, joint: int
) -> None:
    arm.controller.set_limits(0.0, 0.0)
    physics, index = arm.world.physics, arm.arm.joints[joint].index
    working = physics.joint_states

    def broken(body: int, joints: Sequence[int]) -> list[JointState]:
        states = zip(joints, working(body, joints), strict=True)
        return [state._replace(**{quantity: math.nan}) if each == index else state for each, state in states]

    before = arm.controller.tool_pose()
    arm.controller.set_reference(Pose((0.5, 0.2, 0.6), before.orientation))
    arm.world.step(100)
    at_fault = arm.controller.tool_pose()
    monkeypatch.setattr(physics, "joint_states", broken)
    arm.world.step(200)
    assert arm.controller.stop is not None
    assert arm.controller.stop.quantity == guard.NOT_FINITE
    with pytest.raises(Refused):
        arm.controller.set_reference(before)
    monkeypatch.undo()
    assert speed(arm) < 0.02
    assert distances(arm.controller.tool_pose(), at_fault)[0] < 0.02
    arm.controller.set_limits(0.0, 0.0)
    arm.controller.set_reference(at_fault)
    arm.world.step(500)
    assert distances(arm.controller.tool_pose(), at_fault)[0] < 0.005, "it follows again"


def test_reference_with_a_number_that_is_not_finite_is_refused(arm: MovedRobot) -> None:
    reference = arm.controller.impedance.reference
    for place, number in itertools.product(range(7), (math.nan, math.inf)):
        numbers = [*reference.position, *reference.orientation]
        numbers[place] = number
        with pytest.raises(WrongValue):
            arm.controller.set_reference(Pose(tuple(numbers[:3]), tuple(numbers[3:])))
    arm.world.step(100)
    assert distances(arm.controller.impedance.reference, reference)[0] < 1e-6


def test_sensor_without_finite_values_cannot_be_zeroed(arm: MovedRobot) -> None:
    arm.world.faults.set("nan_sensor", ARM)
    with pytest.raises(Refused, match="not finite"):
        arm.controller.zero_sensor()
    arm.world.faults.clear("nan_sensor", ARM)
    assert np.isfinite(arm.arm.measured_wrench()).all()


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.3)])
def test_arm_that_is_hit_at_the_limit_rests_within_a_fifth_of_a_second(
    arm: MovedRobot, direction: tuple[float, float, float]
) -> None:
    x, y, z = (120.0 * part for part in direction)
    arm.world.push(GRIPPER, (x, y, z), duration=0.05)
    while arm.controller.stop is None:
        arm.world.step()
    arm.world.step(50)  # the push ends
    assert speed(arm) > 0.1
    arm.world.step(200)
    assert speed(arm) < 0.03
    arm.world.step(300)
    assert speed(arm) < 0.03, "it does not swing back"


def test_arm_that_stopped_for_its_sensor_is_held_by_its_motors(arm: MovedRobot) -> None:
    arm.world.faults.set("nan_sensor", ARM, 3.0)
    arm.world.step(250)
    before = arm.controller.tool_pose()
    arm.world.push(GRIPPER, (20.0, 0.0, 0.0), duration=0.3)
    arm.world.step(300)
    assert distances(arm.controller.tool_pose(), before)[0] < 0.0005, "it does not yield"
    arm.world.faults.clear("nan_sensor", ARM)
    arm.controller.set_limits(LIMIT, 10.0)
    arm.world.push(GRIPPER, (20.0, 0.0, 0.0), duration=0.3)
    arm.world.step(300)
    assert distances(arm.controller.tool_pose(), before)[0] > 0.005, "it is compliant again"


def test_arm_that_stopped_at_a_limit_yields(arm: MovedRobot) -> None:
    arm.world.push(GRIPPER, (45.0, 0.0, 0.0), duration=0.1)
    arm.world.step(400)
    assert arm.controller.stop is not None
    before = arm.controller.tool_pose()
    arm.world.push(GRIPPER, (20.0, 0.0, 0.0), duration=0.3)
    arm.world.step(300)
    assert distances(arm.controller.tool_pose(), before)[0] > 0.005
