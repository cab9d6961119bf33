"""Trajectories of a simulated arm: execution, waiting, cancelling, rejection, collisions."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from skiros2_motion.core.geometry import Pose, composed, inverted
from skiros2_motion.core.motion import State
from skiros2_sim.core import joint_motion as codes
from skiros2_sim.core.joint_motion import JointGoal, JointMotion, JointPoint, JointTolerance
from skiros2_sim.core.world import World
from support.moved_robot import DOWN, MovedRobot, succeeded
from support.simulated_cell import TABLE_1, cell


def turned(robot: MovedRobot, by: float) -> tuple[float, ...]:
    """The arm as it is, its first joint turned."""
    first, *rest = robot.arm.positions()
    return first + by, *rest


def goal(robot: MovedRobot, *points: JointPoint, **more: object) -> JointMotion:
    made = JointGoal(robot.joints, points)
    return JointMotion(robot.controller, dataclasses.replace(made, **more))  # type: ignore[arg-type]


def test_arm_follows_a_trajectory(robot: MovedRobot) -> None:
    end = np.array(turned(robot, 0.8))
    off: list[float] = []
    motion = robot.trajectory(end, 2.0)
    begin = robot.world.time
    succeeded(robot.run(motion, lambda: off.append(np.max(np.abs(motion.feedback()[2].positions)))))
    assert robot.world.time - begin == pytest.approx(2.0, abs=0.05)
    assert max(off) < 0.005
    assert robot.arm.positions() == pytest.approx(end, abs=0.002)
    desired, actual, error = motion.feedback()
    assert desired.positions - actual.positions == pytest.approx(error.positions)


def test_arm_is_at_rest_afterwards(robot: MovedRobot) -> None:
    succeeded(robot.run(robot.trajectory(turned(robot, 0.3), 1.0)))
    before = robot.arm.positions()
    robot.world.step(120)
    assert robot.arm.positions() == pytest.approx(before, abs=0.001)


def test_joint_names_may_have_the_arm_prefix(robot: MovedRobot) -> None:
    names = tuple("arm/" + name for name in robot.joints)
    points = (JointPoint(0.5, turned(robot, 0.1)),)
    succeeded(robot.run(JointMotion(robot.controller, JointGoal(names, points))))


def test_later_trajectory_waits(robot: MovedRobot) -> None:
    start = robot.world.time + 0.5
    before = robot.arm.positions()
    motion = goal(robot, JointPoint(1.0, turned(robot, 0.3)), start=start)
    robot.world.motions.add(motion)
    robot.world.step(118)
    assert robot.arm.positions() == pytest.approx(before, abs=1e-4)
    succeeded(robot.run(motion))
    assert robot.world.time == pytest.approx(start + 1.0, abs=0.05)


def test_earlier_trajectory_continues_with_its_remaining_points(robot: MovedRobot) -> None:
    robot.world.step(240)
    begin = robot.world.time
    points = JointPoint(0.5, turned(robot, 0.1)), JointPoint(2.0, turned(robot, 0.3))
    succeeded(robot.run(goal(robot, *points, start=begin - 1.0)))
    assert robot.world.time - begin == pytest.approx(1.0, abs=0.05)


def test_past_trajectory_is_rejected(robot: MovedRobot) -> None:
    robot.world.step(240)
    outcome = goal(robot, JointPoint(0.5, turned(robot, 0.1)), start=0.1).outcome
    assert outcome is not None
    assert (outcome.state, outcome.code) == (State.REJECTED, codes.OLD_HEADER_TIMESTAMP)
    assert "began 1.150 s ago and ended 0.650 s ago" in outcome.text


def test_cancelled_trajectory_brakes_on_its_path(robot: MovedRobot) -> None:
    motion = robot.trajectory(turned(robot, 1.0), 2.0)
    robot.world.motions.add(motion)
    robot.world.step(200)
    speed = robot.arm.velocities()[0]
    assert speed > 0.5
    motion.cancel()
    slower = [speed]
    outcome = robot.run(motion, lambda: slower.append(robot.arm.velocities()[0]))
    assert outcome.state is State.PREEMPTED
    assert len(slower) > 20
    assert max(abs(np.diff(slower))) < 0.1, "no jump"
    robot.world.step(10)
    assert abs(robot.arm.velocities()[0]) < 0.01
    assert abs(turned(robot, 0.0)[0]) < 0.95


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        ({"joints": ("panda_joint1",)}, codes.INVALID_JOINTS, "arm/panda_joint2.* is missing"),
        ({"joints": tuple("abcdefg")}, codes.INVALID_JOINTS, "no joint 'arm/a'"),
        ({"points": ()}, codes.INVALID_GOAL, "no points"),
        ({"points": (JointPoint(1.0, (math.nan,) * 7),)}, codes.INVALID_GOAL, "panda_joint1 is nan"),
        ({"points": (JointPoint(0.01, (1.0,) * 7),)}, codes.INVALID_GOAL, "panda_joint1|panda_joint4"),
        ({"points": (JointPoint(0.0, (0.5, 0, 0, -1, 0, 1, 0)),)}, codes.INVALID_GOAL, "begins immediately .*joint1"),
        ({"start": math.nan}, codes.INVALID_GOAL, "start nan"),
        ({"goal_time_tolerance": -1.0}, codes.INVALID_GOAL, "goal time tolerance -1.0"),
        ({"path_tolerance": {"panda_joint1": JointTolerance(math.nan)}}, codes.INVALID_GOAL, "the tolerance of"),
        ({"goal_tolerance": {"x": JointTolerance(0.1)}}, codes.INVALID_JOINTS, "goal tolerance for 'arm/x'"),
    ],
)
def test_invalid_trajectory_is_rejected_before_motion(
    robot: MovedRobot, change: dict[str, object], code: int, said: str
) -> None:
    before = robot.arm.positions()
    motion = goal(robot, JointPoint(1.0, turned(robot, 0.1)), **change)
    assert motion.outcome is not None
    assert (motion.outcome.state, motion.outcome.code) == (State.REJECTED, code)
    assert re.search(said, motion.outcome.text), motion.outcome.text
    motion.feedback()
    robot.world.step(20)
    assert robot.arm.positions() == pytest.approx(before, abs=1e-4)


def test_compliant_arm_rejects_trajectories(robot: MovedRobot) -> None:
    robot.controller.switch("compliant")
    outcome = robot.trajectory(turned(robot, 0.1)).outcome
    assert outcome is not None
    assert "controller 'compliant' of arm arm is active; a trajectory needs 'position'" in outcome.text
    robot.controller.switch("position")
    succeeded(robot.run(robot.trajectory(turned(robot, 0.1))))


def test_switch_to_compliance_aborts_a_trajectory(robot: MovedRobot) -> None:
    motion = robot.trajectory(turned(robot, 0.5))
    robot.world.motions.add(motion)
    robot.world.step(50)
    robot.controller.switch("compliant")
    outcome = robot.run(motion)
    assert outcome.state is State.ABORTED
    assert "'compliant' was activated meanwhile" in outcome.text


def test_collision_is_named_and_released(robot: MovedRobot) -> None:
    world = robot.world
    into_the_table = Pose((0.55, -0.3, 0.3), DOWN)
    found = robot.controller.kinematics.inverse(
        composed(inverted(robot.robot.pose()), into_the_table), robot.arm.positions()
    )
    assert found.converged
    outcome = robot.run(robot.trajectory(found.positions, 4.0))
    assert (outcome.state, outcome.code) == (State.ABORTED, codes.PATH_TOLERANCE_VIOLATED)
    assert "off the path, 0.1 is allowed" in outcome.text
    assert f"it touches {TABLE_1} (" in outcome.text
    world.step(60)
    assert sum(contact.force for contact in world.contacts(TABLE_1) if "arm/" in contact.first) < 5.0
    assert max(map(abs, robot.arm.velocities())) < 0.01, "it holds still"


def test_collision_with_the_own_base_is_named() -> None:
    with World(cell()) as world:
        world.step(60)
        robot = MovedRobot(world)
        outcome = robot.run(robot.trajectory((math.pi / 2 * 1.6, 1.75, 0.0, -0.3, 0.0, 1.5, 0.8), 3.0))
        assert outcome.code == codes.PATH_TOLERANCE_VIOLATED
        assert "it touches mobile_manipulator/base/" in outcome.text


def test_missed_goal_tolerance_aborts(robot: MovedRobot) -> None:
    exact = {"panda_joint1": JointTolerance(1e-9)}
    motion = goal(robot, JointPoint(0.5, turned(robot, 0.2)), goal_tolerance=exact, goal_time_tolerance=0.3)
    outcome = robot.run(motion)
    assert outcome.code == codes.GOAL_TOLERANCE_VIOLATED
    assert "0.30 s after the trajectory's end: arm/panda_joint1 is" in outcome.text


def test_negative_tolerances_are_unlimited(robot: MovedRobot) -> None:
    world, arm = robot.world, robot.arm
    free = {name: JointTolerance(-1.0, -1.0) for name in robot.joints}
    motion = goal(robot, JointPoint(0.5, turned(robot, 0.1)), path_tolerance=free, goal_tolerance=free)
    world.motions.add(motion)
    world.step(10)
    world.physics.set_joint(arm.body, arm.joints[0].index, 1.0)
    succeeded(robot.run(motion))
