"""Motions of a simulated gripper: widths, objects, lost objects."""

from __future__ import annotations

import math

import pytest

from skiros2_motion.core.motion import State
from skiros2_sim.core.gripper import GripperMotion
from support.moved_robot import MovedRobot, succeeded
from support.simulated_cell import EDGE, PRODUCTS


@pytest.fixture
def holding(robot: MovedRobot) -> MovedRobot:
    """The robot with a product in its hand, above the tray."""
    x, y, z = robot.world.pose_of(PRODUCTS[0]).position
    succeeded(robot.run(robot.line((x, y, z + 0.1))))
    succeeded(robot.run(robot.line((x, y, z))))
    succeeded(robot.run(robot.grip(0.0, 15.0)))
    succeeded(robot.run(robot.line((x, y, z + 0.1))))
    return robot


def test_gripper_reaches_a_width(robot: MovedRobot) -> None:
    for width in (0.03, 0.0, 0.08):
        motion = robot.grip(width)
        succeeded(robot.run(motion))
        assert motion.reached_goal
        assert not motion.stalled
        assert motion.width == pytest.approx(width, abs=0.001)


def test_gripper_holds_an_object(holding: MovedRobot) -> None:
    assert holding.gripper.width() == pytest.approx(EDGE, abs=0.002)
    holding.world.step(480)
    assert holding.gripper.width() == pytest.approx(EDGE, abs=0.002)
    again = holding.grip(0.0, 15.0)
    begin = holding.world.time
    succeeded(holding.run(again))
    assert again.stalled
    assert not again.reached_goal
    assert holding.world.time - begin < 0.3, "asked again it tells soon that it still holds it"
    assert again.effort == pytest.approx(15.0, abs=0.5)
    assert again.outcome is not None
    assert "holds the fingers 0.05" in again.outcome.text


def test_lost_object_changes_the_width(holding: MovedRobot) -> None:
    holding.world.faults.set("slipping_gripper", holding.gripper.id, 0.0)
    for _ in range(1000):
        if holding.gripper.width() < 0.01:
            break
        holding.world.step()
    assert holding.gripper.width() < 0.01
    motion = holding.grip(0.0)
    succeeded(holding.run(motion))
    assert motion.reached_goal, "there is nothing between the fingers"


def test_cancelled_gripper_stops(robot: MovedRobot) -> None:
    motion = robot.grip(0.0)
    robot.world.motions.add(motion)
    robot.world.step(60)
    motion.cancel()
    assert motion.outcome is not None
    assert motion.outcome.state is State.PREEMPTED
    width = motion.width
    assert 0.01 < width < 0.07
    robot.world.step(120)
    assert motion.width == pytest.approx(width, abs=0.002)


def test_cancelled_gripper_keeps_its_object(holding: MovedRobot) -> None:
    motion = holding.grip(0.0, 15.0)
    holding.world.motions.add(motion)
    holding.world.step(2)
    motion.cancel()
    holding.world.step(240)
    assert motion.width == pytest.approx(EDGE, abs=0.002)
    assert holding.world.pose_of(PRODUCTS[0]).position[2] > 0.5


@pytest.mark.parametrize(
    ("width", "effort", "said"),
    [
        (math.nan, 0.0, "width nan m: gripper gripper opens from 0 to 0.08 m"),
        (0.2, 0.0, "width 0.2 m"),
        (-0.1, 0.0, "width -0.1 m"),
        (0.05, math.inf, "effort inf N"),
        (0.05, -1.0, "effort -1.0 N: expected a number, 0 or more"),
    ],
)
def test_invalid_command_is_rejected(robot: MovedRobot, width: float, effort: float, said: str) -> None:
    motion = GripperMotion(robot.gripper, width, effort)
    assert motion.outcome is not None
    assert motion.outcome.state is State.REJECTED
    assert said in motion.outcome.text
    robot.world.step(20)
    assert robot.gripper.width() == pytest.approx(0.08, abs=0.001), "it did not move"
