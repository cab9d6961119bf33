"""Straight motions of a simulated tool under position control and compliance."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import IDENTITY, Pose, between, from_euler, multiplied
from skiros2_motion.core.motion import State
from skiros2_sim.core import cartesian_motion as codes
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.cartesian_motion import CartesianGoal, CartesianMotion
from skiros2_sim.core.scene_spec import ArmSpec, RobotSpec, SceneSpec
from skiros2_sim.core.world import World
from support.moved_robot import DOWN, MovedRobot, succeeded
from support.simulated_cell import ARM, EDGE, PRODUCTS, ROBOT, TABLE_1, bench

CONTROLLERS = pytest.mark.parametrize("controller", ["position", "compliant"])
TABLE_TOP = 0.4
FREE = (0.5, -0.3, 0.7)  # m, above the table where it is empty


def refused(motion: CartesianMotion, code: int, said: str) -> None:
    assert motion.outcome is not None
    assert (motion.outcome.state, motion.outcome.code) == (State.REJECTED, code)
    assert re.search(said, motion.outcome.text), motion.outcome.text


@CONTROLLERS
def test_tool_moves_straight_and_rotates_evenly(robot: MovedRobot, controller: str) -> None:
    start = robot.arm.tool_pose()
    target = Pose((0.45, -0.3, 0.65), multiplied(from_euler(0.0, 0.3, 0.8), DOWN))
    way = np.subtract(target.position, start.position)
    beside: list[float] = []
    speeds: list[float] = []

    def watch() -> None:
        here = np.subtract(robot.arm.tool_pose().position, start.position)
        along = here @ way / (way @ way)
        beside.append(float(np.linalg.norm(here - along * way)))
        speeds.append(math.hypot(*robot.arm.tool_velocity()[0]))

    motion = CartesianMotion(robot.controller, CartesianGoal(target, speed=0.2, controller=controller))
    succeeded(robot.run(motion, watch))
    off, turned = distances(robot.arm.tool_pose(), target)
    assert (off, turned) < ((0.002, 0.01) if controller == "position" else (0.01, 0.05))
    assert max(beside) < (0.001 if controller == "position" else 0.01)
    assert max(speeds) < 0.25
    assert motion.feedback().distance == pytest.approx(off)
    assert robot.controller.active == controller


@CONTROLLERS
def test_tool_holds_its_pose_afterwards(robot: MovedRobot, controller: str) -> None:
    succeeded(robot.run(robot.line(FREE, controller=controller)))
    before = robot.arm.tool_pose()
    robot.world.step(240)
    assert distances(robot.arm.tool_pose(), before) < (0.01, 0.05)
    assert max(map(abs, robot.arm.velocities())) < 0.01


def test_controller_switch_is_smooth(robot: MovedRobot) -> None:
    moved: list[float] = []
    before = robot.arm.tool_pose()
    for name in ("compliant", "position", "compliant"):
        robot.controller.switch(name)
        assert robot.controller.active == name
        for _ in range(60):
            robot.world.step()
            moved.append(distances(robot.arm.tool_pose(), before)[0])
    assert max(moved) < 0.001
    with pytest.raises(UnknownName, match="no controller 'magic'; it has position and compliant"):
        robot.controller.switch("magic")


def test_controller_switch_is_smooth_with_a_load(robot: MovedRobot) -> None:
    x, y, z = robot.world.pose_of(PRODUCTS[0]).position
    succeeded(robot.run(robot.line((x, y, z + 0.1))))
    succeeded(robot.run(robot.line((x, y, z))))
    succeeded(robot.run(robot.grip(0.0)))
    succeeded(robot.run(robot.line((x, y, z + 0.1))))
    before = robot.arm.tool_pose()
    robot.controller.switch("compliant")
    robot.world.step(240)
    assert distances(robot.arm.tool_pose(), before)[0] < 0.001, "it carries the weight"


def test_compliant_tool_compensates_its_load() -> None:
    scene = bench()
    heavy = dataclasses.replace(scene.bodies[-1], mass=0.8)
    with World(dataclasses.replace(scene, bodies=(*scene.bodies[:-1], heavy))) as world:
        world.step(60)
        robot = MovedRobot(world)
        x, y, z = world.pose_of(heavy.id).position
        succeeded(robot.run(robot.line((x, y, z), controller="compliant")))
        succeeded(robot.run(robot.grip(0.0)))
        succeeded(robot.run(robot.line((x, y, z + 0.15))))
        assert robot.arm.tool_pose().position[2] == pytest.approx(z + 0.15, abs=0.005)
        succeeded(robot.run(robot.line((x, y + 0.05, z + 0.1))))


def test_compliance_is_stable_with_a_light_hand() -> None:
    kuka = ArmSpec(ARM, "arm", "kuka_iiwa/model.urdf", Pose((0.0, 0.0, 0.3), IDENTITY.orientation))
    with World(SceneSpec((), (RobotSpec(ROBOT, "kuka", arms=(kuka,)),))) as world:
        arm = world.arms[ARM]
        controller = ArmController(world, world.robots[ROBOT], arm)
        world.step(60)
        before = arm.tool_pose()
        controller.switch("compliant")
        world.step(480)
        assert distances(arm.tool_pose(), before) < (0.001, 0.005)
        assert max(map(abs, arm.velocities())) < 0.01


def test_compliant_tool_yields_and_returns(robot: MovedRobot) -> None:
    succeeded(robot.run(robot.line(FREE, controller="compliant", stiffness=(300.0, 600.0, 600.0, 30.0, 30.0, 30.0))))
    before = np.array(robot.arm.tool_pose().position)
    robot.world.push(robot.gripper.id, (15.0, 0.0, 0.0), duration=2.0)
    robot.world.step(400)
    moved = np.array(robot.arm.tool_pose().position) - before
    assert moved[0] == pytest.approx(15.0 / 300.0, rel=0.25), "force by stiffness"
    assert abs(moved[2]) < 0.02
    robot.world.step(480)
    assert np.array(robot.arm.tool_pose().position) == pytest.approx(before, abs=0.005)


@CONTROLLERS
def test_motion_ends_at_contact(robot: MovedRobot, controller: str) -> None:
    x, y, _ = FREE
    succeeded(robot.run(robot.line((x, y, TABLE_TOP + 0.05), controller=controller)))
    motion = robot.line((x, y, TABLE_TOP - 0.05), speed=0.05, contact_force=5.0)
    outcome = robot.run(motion)
    succeeded(outcome)
    assert re.search(rf"contact of \d+.\d N, it touches {TABLE_1} ", outcome.text)
    assert robot.arm.tool_pose().position[2] == pytest.approx(TABLE_TOP + 0.007, abs=0.01)
    assert np.linalg.norm(motion.feedback().wrench[:3]) >= 5.0
    robot.world.step(60)
    assert np.linalg.norm(robot.arm.wrench()[:3]) < 30.0, "it does not push on"
    succeeded(robot.run(robot.line((x, y, TABLE_TOP + 0.05), max_force=1.0)))  # less than it feels: it may go away


def test_motion_without_expected_contact_fails(robot: MovedRobot) -> None:
    outcome = robot.run(robot.line(FREE, contact_force=5.0))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.NO_CONTACT)
    assert "without a contact of 5 N" in outcome.text


def test_load_is_not_a_contact(robot: MovedRobot) -> None:
    x, y, z = robot.world.pose_of(PRODUCTS[0]).position
    succeeded(robot.run(robot.line((x, y, z))))
    succeeded(robot.run(robot.grip(0.0)))
    succeeded(robot.run(robot.line((x, y, z + 0.1))))
    outcome = robot.run(robot.line((x, y, z - 0.05), speed=0.05, contact_force=1.5))
    succeeded(outcome)
    assert robot.world.pose_of(PRODUCTS[0]).position[2] == pytest.approx(0.42 + EDGE / 2, abs=0.006), "on the tray"


def test_force_limit_names_the_contact(robot: MovedRobot) -> None:
    x, y, _ = FREE
    succeeded(robot.run(robot.line((x, y, TABLE_TOP + 0.05))))
    outcome = robot.run(robot.line((x, y, TABLE_TOP - 0.1), speed=0.1, max_force=20.0))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.FORCE_LIMIT)
    assert re.search(rf"felt \d+.\d N, 20 N are allowed, it touches {TABLE_1} \(", outcome.text)
    robot.world.step(60)
    assert np.linalg.norm(robot.arm.wrench()[:3]) < 5.0, "it has gone back"


def test_compliant_tool_without_progress_is_blocked(robot: MovedRobot) -> None:
    x, y, _ = FREE
    succeeded(robot.run(robot.line((x, y, TABLE_TOP + 0.03), controller="compliant")))
    outcome = robot.run(robot.line((x, y, TABLE_TOP - 0.05), speed=0.1))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.BLOCKED)
    assert re.search(rf"stays 0.0\d\d m .* from its target, it touches {TABLE_1} ", outcome.text)


def test_motion_ends_at_its_timeout(robot: MovedRobot) -> None:
    outcome = robot.run(robot.line(FREE, speed=0.1, timeout=0.5))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.TIMED_OUT)
    assert "not at the target after 0.50 s: 0." in outcome.text


@CONTROLLERS
def test_cancelled_motion_brakes_on_its_line(robot: MovedRobot, controller: str) -> None:
    motion = robot.line(FREE, controller=controller)
    robot.world.motions.add(motion)
    robot.world.step(200)
    motion.cancel()
    outcome = robot.run(motion)
    assert (outcome.state, outcome.code) == (State.PREEMPTED, codes.PREEMPTED)
    robot.world.step(180)
    assert math.hypot(*robot.arm.tool_velocity()[0]) < 0.01
    assert distances(robot.arm.tool_pose(), Pose(FREE, DOWN))[0] > 0.02


def test_unreachable_target_aborts_without_motion(robot: MovedRobot) -> None:
    before = robot.arm.positions()
    for position, said in (((2.0, 0.0, 0.6), r"no joint positions .* off by 1\.\d"), ((0.0, 0.0, 0.1), r"off by 0\.")):
        outcome = robot.run(robot.line(position))
        assert (outcome.state, outcome.code) == (State.ABORTED, codes.UNREACHABLE)
        assert re.search(said, outcome.text), outcome.text
    robot.world.step(10)
    assert robot.arm.positions() == pytest.approx(before, abs=1e-4)


def test_unreachable_line_aborts_with_the_reason(robot: MovedRobot) -> None:
    outcome = robot.run(robot.line((-0.45, 0.1, 0.6)))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.UNREACHABLE)
    said = r"the straight path is not reachable beyond 0.\d+ m of 0.\d+ m \(.*\), though its target is"
    assert re.search(said, outcome.text), outcome.text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": math.nan}, "speed nan"),
        ({"speed": -1.0}, "speed -1.0: expected a number from 0 to 2"),
        ({"speed": 1e30}, "speed 1e"),
        ({"angular_speed": math.inf}, "angular_speed inf"),
        ({"controller": "magic"}, "no controller 'magic'; it has position and compliant"),
        ({"stiffness": (1.0, 2.0)}, "expected 6 finite numbers"),
        ({"stiffness": (1e9,) * 6}, r"stiffness 1e\+09 of x: expected 0 to 2000"),
        ({"stiffness": (math.nan,) * 6}, "expected 6 finite numbers"),
        ({"max_force": -1.0}, "max_force -1.0"),
        ({"contact_force": 50.0, "max_force": 20.0}, "contact_force 50.0: expected a number from 0 to 20"),
        ({"timeout": math.nan}, "timeout nan"),
    ],
)
def test_invalid_numbers_and_names_are_rejected(robot: MovedRobot, change: dict[str, object], said: str) -> None:
    refused(robot.line(FREE, **change), codes.INVALID_GOAL, said)
    assert robot.controller.active == "position"


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (Pose((math.nan, 0.0, 0.5), DOWN), "numbers that are not finite"),
        (Pose((0.5, 0.0, 0.5), (0.0, 0.0, 0.0, 0.0)), "length 0.000, expected 1"),
        (Pose((1e300, 0.0, 0.5), DOWN), "farther than 1000 m"),
    ],
)
def test_invalid_targets_are_rejected(robot: MovedRobot, target: Pose, said: str) -> None:
    motion = CartesianMotion(robot.controller, CartesianGoal(target))
    assert motion.outcome is not None
    assert motion.outcome.state is State.REJECTED
    assert said in motion.outcome.text


def test_invalid_stiffness_is_rejected(robot: MovedRobot) -> None:
    robot.controller.stiffness = (100.0,) * 3 + (10.0,) * 3
    assert robot.controller.stiffness == (100.0,) * 3 + (10.0,) * 3
    with pytest.raises(WrongValue, match=r"stiffness -1 of rz: expected 0 to 300"):
        robot.controller.stiffness = (50.0,) * 5 + (-1.0,)


def test_motion_to_the_current_pose_ends_immediately(robot: MovedRobot) -> None:
    motion = CartesianMotion(robot.controller, CartesianGoal(robot.arm.tool_pose()))
    succeeded(robot.run(motion))


def test_rotation_takes_the_shorter_direction() -> None:
    quarter = from_euler(0.0, 0.0, math.pi / 2)
    opposite = Pose((2.0, 0.0, 0.0), tuple(-c for c in quarter))  # type: ignore[arg-type]
    half = between(IDENTITY, opposite, 0.5)
    assert distances(half, Pose((1.0, 0.0, 0.0), from_euler(0.0, 0.0, math.pi / 4))) < (1e-9, 1e-9)
