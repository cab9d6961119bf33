"""The simulated world: bodies, robots, contacts, faults, reproducibility."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pybullet
import pytest

from skiros2_common.core.errors import Refused, UnknownName, WrongType, WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, angle_between, from_euler, rotated, to_euler
from skiros2_sim.core.contacts import Contact
from skiros2_sim.core.scene_spec import BodySpec, CameraSpec, SceneSpec
from skiros2_sim.core.world import GROUND, World
from support.simulated_cell import (
    ARM,
    BASE,
    EDGE,
    GRIPPER,
    PRODUCTS,
    ROBOT,
    TABLE_1,
    TABLE_2,
    TRAY_TOP,
    TRAYS,
    at,
    cell,
    product,
)

PRODUCT = PRODUCTS[0]
DOWN = from_euler(math.pi, 0.0, 0.0)


def state_of(world: World) -> list[object]:
    """Everything that moves, bit for bit."""
    found: list[object] = [world.time, world.contacts()]
    found += [(eid, body.pose(), body.velocity()) for eid, body in world.bodies.items()]
    for robot in world.robots.values():
        found += [robot.link_poses(), robot.velocity()]
        found += [(arm.positions(), arm.velocities(), arm.efforts()) for arm in robot.arms.values()]
    return found


def reach(world: World, position: Vector, seconds: float = 1.0) -> None:
    """Moves the tool of the Panda there, pointing down, in a straight line of its joints."""
    arm = world.arms[ARM]
    start = np.array(arm.positions())
    found = pybullet.calculateInverseKinematics(
        arm.body, arm.tool_link, position, DOWN, maxNumIterations=100, physicsClientId=world.physics.id
    )
    goal = np.array(found[: len(start)])
    steps = round(seconds / world.dt)
    for step in range(1, steps + 1):
        arm.drive(start + (goal - start) * step / steps, (goal - start) / seconds)
        world.step()
    arm.drive(goal)
    world.step(60)


def grip(world: World, lift: float = 0.2) -> None:
    """Grips the product of the bench and lifts it."""
    x, y, z = world.pose_of(PRODUCT).position
    reach(world, (x, y, z + 0.15), 1.5)
    reach(world, (x, y, z))
    world.grippers[GRIPPER].drive(0.0)
    world.step(120)
    reach(world, (x, y, z + lift))


# -- things -----------------------------------------------------------------------------------------------------------


def test_products_rest_in_their_trays(world: World) -> None:
    world.step(240)
    for eid, tray in zip(PRODUCTS, (TRAYS[0], TRAYS[1], TRAYS[3]), strict=True):
        start = next(body.pose for body in world.scene.bodies if body.id == eid)
        assert world.pose_of(eid).position == pytest.approx(start.position, abs=1e-3)
        (contact,) = world.contacts(eid)
        assert (contact.first, contact.second) == (tray, eid)
        assert contact.force == pytest.approx(0.2 * 9.81, rel=0.02)
        assert contact.position[2] == pytest.approx(TRAY_TOP, abs=1e-3)
    assert world.problems == []
    assert world.time == pytest.approx(1.0)


def test_placed_body_falls(world: World) -> None:
    world.set_pose(PRODUCT, at(0.0, 3.0, 1.0))
    assert world.pose_of(PRODUCT).position == pytest.approx((0.0, 3.0, 1.0))
    world.step(24)
    (_, _, speed), _ = world.velocity_of(PRODUCT)
    assert speed == pytest.approx(-0.981, rel=0.02)
    world.step(240)
    assert world.pose_of(PRODUCT).position[2] == pytest.approx(EDGE / 2, abs=1e-3)
    (contact,) = world.contacts(PRODUCT)
    assert (contact.first, contact.second) == (GROUND, PRODUCT)


def test_push_acts_for_its_duration(world: World) -> None:
    world.set_pose(PRODUCT, at(0.0, 3.0, 5.0))
    world.push(PRODUCT, (0.4, 0.0, 0.0), duration=0.1)
    world.step(48)
    (speed, _, _), _ = world.velocity_of(PRODUCT)
    assert speed == pytest.approx(0.4 / 0.2 * 0.1, rel=0.02)


def test_push_ends_with_its_body(world: World) -> None:
    world.add_body(product("skiros:Product-99", at(0.0, 3.0, 1.0)))
    world.push("skiros:Product-99", (1.0, 0.0, 0.0), duration=10.0)
    world.step(2)
    world.remove_body("skiros:Product-99")
    world.step(2)
    with pytest.raises(UnknownName, match="Product-99"):
        world.pose_of("skiros:Product-99")
    with pytest.raises(UnknownName, match="Product-99"):
        world.remove_body("skiros:Product-99")


NAN = float("nan")


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda w: w.pose_of("nobody"), UnknownName, "nobody"),
        (lambda w: w.velocity_of(""), UnknownName, PRODUCT),
        (lambda w: w.contacts("nobody"), UnknownName, "nobody"),
        (lambda w: w.set_pose("nobody", IDENTITY), UnknownName, "nobody"),
        (lambda w: w.set_pose(GRIPPER, IDENTITY), Refused, GRIPPER),
        (lambda w: w.set_pose(PRODUCT, at(NAN, 0.0, 0.0)), WrongValue, PRODUCT),
        (lambda w: w.set_pose(PRODUCT, at(1e30, 0.0, 0.0)), WrongValue, "1000"),
        (lambda w: w.set_pose(PRODUCT, Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0))), WrongValue, "quaternion"),
        (lambda w: w.set_pose(ROBOT, Pose((0.0, 0.0, 0.0), DOWN)), WrongValue, "upright"),
        (lambda w: w.push(TABLE_1, (1.0, 0.0, 0.0)), Refused, TABLE_1),
        (lambda w: w.push(PRODUCT, (NAN, 0.0, 0.0)), WrongValue, PRODUCT),
        (lambda w: w.push(PRODUCT, (1e9, 0.0, 0.0)), WrongValue, PRODUCT),
        (lambda w: w.push(PRODUCT, (1.0, 0.0, 0.0), duration=-1.0), WrongValue, PRODUCT),
        (lambda w: w.robots[ROBOT].set_base_velocity(NAN), WrongValue, ROBOT),
        (lambda w: w.arms[ARM].drive([0.0] * 6), WrongValue, ARM),
        (lambda w: w.arms[ARM].drive([0.0] * 7, [NAN] * 7), WrongValue, ARM),
        (lambda w: w.arms[ARM].drive_torques(["x"] * 7), WrongType, ARM),
        (lambda w: w.grippers[GRIPPER].drive(NAN), WrongValue, GRIPPER),
        (lambda w: w.grippers[GRIPPER].drive(0.0, -1.0), WrongValue, GRIPPER),
    ],
)
def test_invalid_operations_are_rejected_with_reason(
    shared_cell: World, call: Callable[[World], object], error: type[Exception], text: str
) -> None:
    before = state_of(shared_cell)
    with pytest.raises(error) as caught:
        call(shared_cell)
    assert text in str(caught.value)
    assert state_of(shared_cell) == before


# -- runs -------------------------------------------------------------------------------------------------------------


def eventful(world: World) -> list[object]:
    """A run in which much happens."""
    found = []
    world.robots[ROBOT].set_base_velocity(0.5, 0.0, 0.3)
    for _ in range(5):
        world.set_pose(PRODUCT, at(1.9, float(world.random.uniform(1.2, 1.8)), 0.8))
        world.push(PRODUCTS[1], (0.5, 0.2, 0.0), duration=0.2)
        world.step(60)
        found.append(state_of(world))
    return found


def test_runs_with_the_same_seed_are_identical(world: World) -> None:
    start = state_of(world)
    first = eventful(world)
    world.reset()
    assert state_of(world) == start
    assert eventful(world) == first
    world.reset(seed=1)
    assert eventful(world) != first
    with World(cell()) as other:
        assert state_of(other) == start
        assert eventful(other) == first


def test_position_noise_depends_on_the_seed(world: World) -> None:
    with World(cell(), seed=3, position_noise=0.01, yaw_noise=0.2) as noisy:
        first = {eid: noisy.pose_of(eid) for eid in PRODUCTS}
        noisy.reset()
        assert {eid: noisy.pose_of(eid) for eid in PRODUCTS} == first
        noisy.reset(seed=4)
        second = {eid: noisy.pose_of(eid) for eid in PRODUCTS}
        for eid in PRODUCTS:
            assert first[eid] != second[eid]
            for pose in (first[eid], second[eid]):
                far = np.subtract(pose.position, world.pose_of(eid).position)
                assert 0 < np.abs(far).max() <= 0.01
                assert far[2] == pytest.approx(0.0, abs=1e-6)
                assert abs(to_euler(pose.orientation)[2]) <= 0.2
        assert noisy.pose_of(TABLE_1) == world.pose_of(TABLE_1)


class Counting:
    """A motion of three steps."""

    def __init__(self, error: Exception | None = None) -> None:
        self.times: list[float] = []
        self.outcome: str | None = None
        self.error = error

    def update(self, dt: float) -> None:
        self.times.append(dt)
        if self.error is not None:
            raise self.error
        if len(self.times) == 3:
            self.outcome = "done"


def test_a_motion_is_updated_before_each_step_until_it_has_an_outcome(world: World) -> None:
    motion = Counting()
    world.motions.add(motion)
    world.motions.add(motion)
    world.step(10)
    assert motion.times == [1 / 240] * 3
    assert len(world.motions) == 0


def test_error_of_a_motion_propagates_and_ends_that_motion(world: World) -> None:
    broken, sound = Counting(WrongValue("broken")), Counting()
    world.motions.add(sound)
    world.motions.add(broken)
    with pytest.raises(WrongValue, match="broken"):
        world.step(10)
    assert list(world.motions) == [sound]
    world.step(2)
    assert sound.outcome == "done"


# -- robots -----------------------------------------------------------------------------------------------------------


def test_base_velocity_is_in_its_own_frame(world: World) -> None:
    robot = world.robots[ROBOT]
    world.set_pose(ROBOT, Pose((-1.0, 0.0, 0.0), from_euler(0.0, 0.0, math.pi / 2)))
    robot.set_base_velocity(0.5)
    world.step(240)
    assert robot.velocity() == pytest.approx((0.5, 0.0, 0.0), abs=0.01)
    x, y, z = robot.pose().position
    assert (x, z) == pytest.approx((-1.0, 0.0), abs=0.01)
    assert y == pytest.approx(0.5, rel=0.1)
    robot.set_base_velocity(0.0, 0.0, 0.4)
    world.step(240)
    assert robot.velocity() == pytest.approx((0.0, 0.0, 0.4), abs=0.01)
    robot.set_base_velocity(0.0)
    world.step(240)
    assert robot.velocity() == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert to_euler(robot.pose().orientation)[2] == pytest.approx(math.pi / 2 + 0.4, abs=0.05)


def test_table_stops_the_base(world: World) -> None:
    robot = world.robots[ROBOT]
    world.set_pose(ROBOT, at(0.6, 1.5, 0.0))
    robot.set_base_velocity(0.5)
    world.step(3 * 240)
    x = robot.pose().position[0]
    assert x + 0.45 < 1.65, "its bumper is before the table"
    assert abs(robot.velocity()[0]) < 0.05
    touched = {(c.first, c.second.partition("/")[0]) for c in world.contacts(ROBOT)}
    assert touched == {(TABLE_1, "mobile_manipulator")}
    assert sum(c.force for c in world.contacts(ROBOT)) > 100


def test_arm_keeps_its_posture_while_driving(world: World) -> None:
    arm, robot = world.arms[ARM], world.robots[ROBOT]
    robot.set_base_velocity(0.5, 0.0, 0.5)
    world.step(240)
    assert arm.positions() == pytest.approx(arm.rest, abs=0.02)
    links = robot.link_poses()
    assert links["arm/tool"] == world.pose_of(GRIPPER) == arm.tool_pose()
    assert links["base_link"] == world.pose_of(ROBOT)
    assert "drive_x" not in links
    assert world.pose_of(ARM).position[2] == pytest.approx(0.39, abs=1e-4)
    linear, angular = arm.tool_velocity()
    assert angular == pytest.approx((0.0, 0.0, 0.5), abs=0.05)
    assert math.hypot(*linear) > 0.5
    assert set(robot.joints) == {f"arm/panda_joint{n}" for n in range(1, 8)} | {
        "arm/panda_finger_joint1",
        "arm/panda_finger_joint2",
    }
    assert {joint.velocity for joint in arm.joints} == {2.175, 2.61}
    assert robot.radius == pytest.approx(0.6, abs=0.1)


def test_motor_efforts_compensate_gravity(world: World) -> None:
    world.step(240)
    arm = world.arms[ARM]
    assert arm.dynamics(False).bias == pytest.approx(arm.efforts(), abs=0.05)
    arm.drive_torques(arm.dynamics(False).bias)
    world.step(1)
    for _ in range(120):
        arm.drive_torques(arm.dynamics(False).bias)
        world.step()
    assert arm.positions() == pytest.approx(arm.rest, abs=0.02), "it floats"
    world.step(60)
    assert arm.positions() != pytest.approx(arm.rest, abs=0.02), "torques are for one step: it falls"


def test_arm_collides_with_its_base(world: World) -> None:
    arm = world.arms[ARM]
    folded = (2.9, 1.3, 0.0, -1.7, 0.0, 3.0, 0.785)
    for step in range(2 * 240):
        arm.drive([a + (b - a) * min(1.0, step / 240) for a, b in zip(arm.rest, folded, strict=True)])
        world.step()
    touched = {(c.first, c.second) for c in world.contacts(ROBOT)}
    assert any(name == "mobile_manipulator/base/base_link" for pair in touched for name in pair)
    assert arm.positions() != pytest.approx(folded, abs=0.05)
    assert all(name.startswith("mobile_manipulator/") for pair in touched for name in pair)


def test_fixed_robot_rejects_velocities(panda: World) -> None:
    robot = panda.robots[ROBOT]
    assert not robot.mobile
    assert robot.velocity() == (0.0, 0.0, 0.0)
    with pytest.raises(Refused, match="Robot-1"):
        robot.set_base_velocity(0.1)
    panda.set_pose(ROBOT, Pose((0.0, 0.0, 1.0), from_euler(0.0, 0.1, 0.0)))
    assert panda.pose_of(ARM).position[2] == pytest.approx(1.3, abs=0.01)


def test_wrist_measures_the_weight_of_a_lifted_object(panda: World) -> None:
    panda.step(60)
    height = panda.pose_of(PRODUCT).position[2]
    grip(panda)
    gripper = panda.grippers[GRIPPER]
    assert gripper.width() == pytest.approx(EDGE, abs=0.003)
    assert gripper.force() == pytest.approx(20, rel=0.1)
    assert panda.pose_of(PRODUCT).position[2] == pytest.approx(height + 0.2, abs=0.005)
    assert {c.second for c in panda.contacts(PRODUCT)} == {
        "stationary/arm/panda_leftfinger",
        "stationary/arm/panda_rightfinger",
    }
    wrench = panda.arms[ARM].wrench()
    assert rotated(panda.arms[ARM].tool_pose().orientation, wrench[:3]) == pytest.approx((0, 0, -1.962), abs=0.1)
    reach(panda, (0.5, -0.1, height))
    gripper.drive(gripper.max_width)
    panda.step(120)
    reach(panda, (0.5, -0.1, height + 0.2))
    assert panda.pose_of(PRODUCT).position == pytest.approx((0.5, -0.1, height), abs=0.005)
    assert panda.contacts(PRODUCT) == [
        Contact(TRAYS[0], PRODUCT, panda.contacts(PRODUCT)[0].position, pytest.approx(1.962, rel=0.05))
    ]


def test_wrist_measures_contact_of_the_fingers(panda: World) -> None:
    arm = panda.arms[ARM]
    assert arm.wrench() == (0.0,) * 6
    reach(panda, (0.5, -0.1, 0.5))
    assert arm.wrench() == (0.0,) * 6
    reach(panda, (0.5, -0.1, 0.41))
    force = rotated(arm.tool_pose().orientation, arm.wrench()[:3])
    assert force[2] > 5
    pressed = sum(c.force for c in panda.contacts(ROBOT))
    assert force[2] == pytest.approx(pressed, rel=0.05)


# -- faults -----------------------------------------------------------------------------------------------------------


def test_slipping_gripper_loses_its_object(panda: World) -> None:
    grip(panda)
    lifted = panda.pose_of(PRODUCT).position[2]
    panda.faults.set("slipping_gripper", GRIPPER, duration=1.0)
    assert [fault.target for fault in panda.faults.active] == [GRIPPER]
    panda.step(240)
    assert panda.pose_of(PRODUCT).position[2] < lifted - 0.1
    assert panda.grippers[GRIPPER].width() == pytest.approx(0.0, abs=0.002)
    panda.step()
    assert panda.faults.active == []
    panda.grippers[GRIPPER].drive(0.08)
    panda.step(120)
    grip(panda)
    assert panda.pose_of(PRODUCT).position[2] == pytest.approx(lifted, abs=0.01), "the grip is back"


def test_blocked_path_removes_its_obstacle_at_the_end(world: World) -> None:
    robot = world.robots[ROBOT]
    robot.set_base_velocity(-0.5)
    world.step(60)
    world.faults.set("blocked_path", ROBOT, 1.2, duration=3.0)
    ((eid, obstacle),) = [(eid, body) for eid, body in world.bodies.items() if "obstacle" in eid]
    assert obstacle.pose().position[0] < robot.pose().position[0] - 1.0, "it is behind: there it drives"
    world.step(int(2.9 * 240))
    assert abs(robot.velocity()[0]) < 0.05
    assert {c.first for c in world.contacts(ROBOT)} == {"mobile_manipulator/base/base_link"}
    world.step(240)
    assert eid not in world.bodies
    assert robot.velocity()[0] == pytest.approx(-0.5, abs=0.01)


def test_fault_is_replaced_and_cleared(world: World) -> None:
    world.faults.set("late_sensor", ARM, 0.5)
    world.faults.set("late_sensor", ARM, 0.2)
    assert world.faults.lag(ARM) == 0.2
    assert world.faults.lag(ROBOT) == 0.0
    world.faults.clear("late_sensor", ARM)
    world.faults.clear("late_sensor", ARM)
    assert world.faults.lag(ARM) == 0.0
    world.faults.set("blocked_path", ROBOT)
    world.reset()
    assert world.faults.active == []
    assert not any("obstacle" in eid for eid in world.bodies)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (("on_fire", ROBOT), UnknownName, "slipping_gripper, blocked_path, late_sensor, silent_sensor"),
        (("slipping_gripper", ARM), UnknownName, GRIPPER),
        (("blocked_path", PRODUCT), UnknownName, ROBOT),
        (("late_sensor", TABLE_2), UnknownName, BASE),
        (("frozen_sensor", GRIPPER), UnknownName, ARM),
        (("nan_sensor", ARM, 7.0), WrongValue, "0 to 6"),
        (("slipping_gripper", GRIPPER, 1.5), WrongValue, "0 to 1"),
        (("slipping_gripper", GRIPPER, NAN), WrongValue, "nan"),
        (("late_sensor", ARM, 0.1, -1.0), WrongValue, "duration"),
        (("late_sensor", ARM, 1e9), WrongValue, "0 to 60"),
    ],
)
def test_invalid_fault_names_the_expected_values(
    shared_cell: World, arguments: tuple[object, ...], error: type[Exception], text: str
) -> None:
    before = shared_cell.faults.active
    with pytest.raises(error, match=text):
        shared_cell.faults.set(*arguments)  # type: ignore[arg-type]
    assert shared_cell.faults.active == before


def test_invalid_seed_and_noise_are_rejected(world: World) -> None:
    with pytest.raises(WrongValue, match="seed"):
        World(SceneSpec(), seed=-1)
    with pytest.raises(WrongValue, match="noise"):
        World(SceneSpec(), position_noise=NAN)
    with pytest.raises(WrongValue, match="seed"):
        world.reset(seed=-1)
    assert world.seed == 0


def test_duplicate_ids_and_detached_cameras_are_problems() -> None:
    twins = (product(PRODUCT, at(0.0, 0.0, 1.0)), product(PRODUCT, at(0.0, 1.0, 1.0)))
    lost = CameraSpec("skiros:DepthCamera-9", "camera", parent="rparts:ArmDevice-99")
    with World(SceneSpec(twins, cameras=(lost,))) as world:
        assert {problem.element for problem in world.problems} == {PRODUCT, lost.id}
        assert world.pose_of(PRODUCT).position[1] == 0.0
        assert world.cameras == {}


def test_empty_world_steps() -> None:
    with World(SceneSpec()) as world:
        world.step(3)
        assert world.steps == 3
        assert world.contacts() == []
    world.close()


def test_window_without_display_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":9999")
    with pytest.raises(Refused, match=":9999"):
        World(SceneSpec(), gui=True)


@pytest.mark.parametrize("far", [0.0, 900.0])
def test_things_come_to_rest_on_the_ground_wherever_it_is(far: float) -> None:
    size = (0.1, 0.06, 0.04)
    falling = BodySpec("box", label="box", pose=Pose((far, 0.0, 0.05), IDENTITY.orientation), size=size, movable=True)
    with World(SceneSpec(bodies=(falling,)), rate=1000) as world:
        world.step(1000)
        before = world.pose_of("box")
        world.step(2000)
        after = world.pose_of("box")
    assert after.position[2] == pytest.approx(size[2] / 2, abs=1e-4)
    assert math.dist(before.position, after.position) < 1e-6
    assert angle_between(before.orientation, after.orientation) < 1e-5
