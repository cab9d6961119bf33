"""Motions of a simulated base: accuracy, obstacles, other robots, failures."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator

import pytest

from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_motion.core.motion import Outcome, State
from skiros2_sim.core.base_motion import BaseMotion
from skiros2_sim.core.drive_path import Pose2D
from skiros2_sim.core.scene_spec import BaseSpec, BodySpec, RobotSpec, SceneSpec
from skiros2_sim.core.world import World
from support.moved_robot import MovedRobot, succeeded
from support.simulated_cell import PRODUCTS, ROBOT, TABLE_1, at, bench, box, product

HUSKY = "husky/husky.urdf"
CART = "cora:Robot-0"


@pytest.fixture
def robot(world: World) -> MovedRobot:
    return MovedRobot(world)


def carts(*poses: Pose2D) -> World:
    """Bases without arms on an empty floor, named in order."""
    robots = [
        RobotSpec(
            f"cora:Robot-{i}",
            f"cart_{i}",
            Pose((x, y, 0.0), from_euler(0.0, 0.0, yaw)),
            base=BaseSpec(f"b{i}", "b", HUSKY),
        )
        for i, (x, y, yaw) in enumerate(poses)
    ]
    return World(SceneSpec((), tuple(robots)))


def block(name: str, x: float, y: float, sx: float = 0.4, sy: float = 0.4) -> BodySpec:
    return box(f"test:{name}", at(x, y, 0.5), (sx, sy, 1.0))


@pytest.fixture
def cart() -> Iterator[World]:
    with carts(Pose2D(0.0, 0.0, 0.0)) as world:
        yield world


def driven(world: World, x: float, y: float = 0.0, yaw: float = 0.0) -> BaseMotion:
    """A motion of the first cart that has begun."""
    motion = BaseMotion(world, world.robots[CART], Pose2D(x, y, yaw))
    world.motions.add(motion)
    return motion


def all_run(world: World, motions: list[BaseMotion], longest: float = 60.0) -> list[Outcome]:
    for motion in motions:
        world.motions.add(motion)
    while any(motion.outcome is None for motion in motions):
        assert world.time < longest
        world.step()
    return [motion.outcome for motion in motions if motion.outcome is not None]


def test_base_arrives_exactly_and_at_rest(robot: MovedRobot) -> None:
    succeeded(robot.run(robot.drive(1.05, 1.5)))
    pose = robot.drive(0.0, 0.0).pose()
    assert (pose.x, pose.y) == pytest.approx((1.05, 1.5), abs=0.01)
    assert pose.yaw == pytest.approx(0.0, abs=0.01)
    assert max(map(abs, robot.robot.velocity())) < 0.01
    robot.world.step(120)
    assert robot.drive(0.0, 0.0).pose() == pytest.approx(pose, abs=0.001)
    begin = robot.world.time
    succeeded(robot.run(robot.drive(1.05, 1.5)))
    assert robot.world.time - begin < 0.1, "it is there already"


def test_base_drives_around_a_table(cart: World) -> None:
    cart.add_body(box(TABLE_1, at(1.0, 0.0, 0.25), (0.8, 1.2, 0.5)))
    motion = driven(cart, 1.95, 0.0, math.pi)
    while motion.outcome is None:
        cart.step()
        if cart.steps % 8 == 0:
            assert not cart.contacts(CART)
    succeeded(motion.outcome)


def test_base_respects_its_acceleration_limit(robot: MovedRobot) -> None:
    speeds = [0.0]
    succeeded(robot.run(robot.drive(-2.0, 0.0, math.pi), lambda: speeds.append(robot.robot.velocity()[0])))
    assert max(speeds) == pytest.approx(0.8, abs=0.05)
    changes = [abs(b - a) * 240 for a, b in itertools.pairwise(speeds)]
    assert max(changes) < 2.0, "m/s2"


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        (Pose2D(2.0, 1.5, 0.0), f"the goal is inside '{TABLE_1}'"),
        (Pose2D(math.nan, 0.0, 0.0), "has numbers that are not finite"),
        (Pose2D(0.0, 0.0, math.inf), "has numbers that are not finite"),
        (Pose2D(500.0, 0.0, 0.0), "x 500.00 is outside of the world, which goes from"),
        (Pose2D(0.0, 1e300, 0.0), "is outside of the world"),
    ],
)
def test_invalid_goal_is_rejected(robot: MovedRobot, goal: Pose2D, said: str) -> None:
    outcome = BaseMotion(robot.world, robot.robot, goal).outcome
    assert outcome is not None
    assert outcome.state is State.REJECTED
    assert said in outcome.text


@pytest.mark.parametrize(
    ("orientation", "said"),
    [
        ((0.0, 0.0, 0.0, 0.0), "numbers that are not finite"),
        ((math.nan, 0.0, 0.0, 1.0), "numbers that are not finite"),
        (from_euler(0.0, 0.5, 0.0), "tilted by 0.50 rad"),
    ],
)
def test_tilted_pose_is_rejected(robot: MovedRobot, orientation: tuple[float, float, float, float], said: str) -> None:
    outcome = BaseMotion.to_pose(robot.world, robot.robot, Pose((0.5, 0.0, 0.0), orientation)).outcome
    assert outcome is not None
    assert said in outcome.text


def test_goal_of_a_fixed_robot_is_rejected() -> None:
    with World(bench()) as world:
        outcome = BaseMotion(world, world.robots[ROBOT], Pose2D(0.0, 0.0, 0.0)).outcome
    assert outcome is not None
    assert "has no mobile base" in outcome.text


def test_cancelled_motion_brakes(robot: MovedRobot) -> None:
    motion = robot.drive(-3.0, 0.0, math.pi)
    robot.world.motions.add(motion)
    while abs(robot.robot.velocity()[0]) < 0.5:
        robot.world.step()
    before = motion.pose()
    motion.cancel()
    outcome = robot.run(motion)
    assert outcome.state is State.PREEMPTED
    assert 0.1 < math.dist(before[:2], motion.pose()[:2]) < 0.5
    assert max(map(abs, robot.robot.velocity())) < 0.01


def test_replacing_motion_brakes_first(cart: World) -> None:
    first = driven(cart, 4.0)
    while cart.robots[CART].velocity()[0] < 0.75:
        cart.step()
    cart.motions.remove(first)
    second = driven(cart, 0.0, 0.0, math.pi)
    speeds = [cart.robots[CART].velocity()[0]]
    for _ in range(60):
        cart.step()
        speeds.append(cart.robots[CART].velocity()[0])
    assert max(abs(b - a) * 240 for a, b in itertools.pairwise(speeds)) < 5.0, "m/s2"
    while second.outcome is None:
        cart.step()
    succeeded(second.outcome)


@pytest.mark.parametrize("ahead", [1.0, 1.5])
def test_base_avoids_a_new_obstacle(cart: World, ahead: float) -> None:
    motion = driven(cart, 4.0)
    while cart.robots[CART].velocity()[0] < 0.75:
        cart.step()
    cart.faults.set("blocked_path", CART, ahead)
    aside = []
    while motion.outcome is None:
        cart.step()
        aside.append(abs(motion.pose().y))
    succeeded(motion.outcome)
    assert max(aside) > 0.5


def test_base_waits_for_a_temporary_obstacle(cart: World) -> None:
    cart.add_body(product("test:thing", at(1.5, 0.0, 0.025)))
    motion = driven(cart, 1.5)
    cart.step(1200)
    assert motion.outcome is None
    cart.remove_body("test:thing")
    cart.step(960)
    assert motion.outcome is not None
    succeeded(motion.outcome)


def test_blocked_base_aborts_and_names_the_obstacle(cart: World) -> None:
    cart.add_body(product("test:thing", at(1.5, 0.0, 0.025)))
    (outcome,) = all_run(cart, [driven(cart, 1.5)])
    assert outcome.state is State.ABORTED
    assert outcome.text == "blocked for 15 s: the goal is inside 'test:thing'"


def test_base_aborts_immediately_behind_fixed_obstacles(cart: World) -> None:
    for name, x, y, sx, sy in (("n", 4, 1, 3, 0.1), ("s", 4, -1, 3, 0.1), ("e", 2.5, 0, 0.1, 2), ("w", 5.5, 0, 0.1, 2)):
        cart.add_body(block(name, x, y, sx, sy))
    (outcome,) = all_run(cart, [driven(cart, 4.0)])
    assert outcome.state is State.ABORTED
    assert "no path to the goal: 'test:" in outcome.text
    assert cart.time < 0.5


def test_collision_aborts_the_motion(robot: MovedRobot) -> None:
    world = robot.world
    world.add_body(
        dataclasses.replace(block("bar", -1.5, 0.0, 0.1, 4.0), pose=at(-1.5, 0.0, 1.35), size=(0.1, 4.0, 0.1))
    )
    up = robot.controller.kinematics.lower * 0.0
    up[3] = -0.1
    succeeded(robot.run(robot.trajectory(up, 3.0)))
    outcome = robot.run(robot.drive(-3.0, 0.0, math.pi))
    assert outcome.state is State.ABORTED
    assert "the robot has collided, it touches test:bar (" in outcome.text


def test_carried_object_is_not_an_obstacle(robot: MovedRobot) -> None:
    world = robot.world
    succeeded(robot.run(robot.drive(1.05, 1.75)))
    x, y, z = world.pose_of(PRODUCTS[0]).position
    succeeded(robot.run(robot.line((x, y, z + 0.1))))
    succeeded(robot.run(robot.line((x, y, z))))
    succeeded(robot.run(robot.grip(0.0)))
    succeeded(robot.run(robot.line((x - 0.2, y, z + 0.1))))
    succeeded(robot.run(robot.drive(0.0, 1.75)))
    assert world.pose_of(PRODUCTS[0]).position[2] > z + 0.08


def test_fingers_do_not_stick_to_an_object_after_half_a_turn(robot: MovedRobot) -> None:
    world = robot.world
    succeeded(robot.run(robot.drive(1.05, 1.75)))
    x, y, z = world.pose_of(PRODUCTS[0]).position
    for position in ((x + 0.002, y, z + 0.1), (x + 0.002, y, z)):
        succeeded(robot.run(robot.line(position)))
    succeeded(robot.run(robot.grip(0.0, 40.0)))
    succeeded(robot.run(robot.line((x - 0.3, y, z + 0.15))))
    succeeded(robot.run(robot.drive(0.0, 1.75, math.pi)))
    assert world.pose_of(PRODUCTS[0]).position[2] > z + 0.1
    motion = robot.grip(0.08)
    succeeded(robot.run(motion))
    assert motion.reached_goal


def test_two_robots_pass_each_other() -> None:
    with carts(Pose2D(0.0, 0.0, 0.0), Pose2D(6.0, 0.0, math.pi)) as world:
        goals = Pose2D(6.0, 0.0, 0.0), Pose2D(0.0, 0.0, math.pi)
        motions = [BaseMotion(world, robot, goal) for robot, goal in zip(world.robots.values(), goals, strict=True)]
        for outcome in all_run(world, motions):
            succeeded(outcome)


def test_three_robots_with_crossing_paths_arrive() -> None:
    with carts(Pose2D(0.0, 0.0, 0.0), Pose2D(3.0, -3.0, math.pi / 2), Pose2D(6.0, 0.1, math.pi)) as world:
        goals = Pose2D(6.0, 0.0, 0.0), Pose2D(3.0, 3.0, math.pi / 2), Pose2D(0.0, 0.0, math.pi)
        motions = [BaseMotion(world, robot, goal) for robot, goal in zip(world.robots.values(), goals, strict=True)]
        for outcome in all_run(world, motions):
            succeeded(outcome)


def test_standing_robot_is_named_as_obstacle() -> None:
    with carts(Pose2D(0.0, 0.0, 0.0), Pose2D(3.0, 0.0, 0.0)) as world:
        (outcome,) = all_run(world, [driven(world, 3.0)])
    assert outcome.text == "blocked for 15 s: the goal is inside 'cora:Robot-1'"


def test_base_with_a_shaking_load_comes_to_rest(robot: MovedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot.robot, "velocity", lambda: (0.02, 0.0, 0.02))
    succeeded(robot.run(robot.drive(0.5, 0.0)))


def test_stuck_base_aborts_with_reason(robot: MovedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot.robot, "set_base_velocity", lambda *velocity: None)
    outcome = robot.run(robot.drive(1.0, 0.0))
    assert (outcome.state, outcome.text) == (State.ABORTED, "the base makes no progress")
