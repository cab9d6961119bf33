"""The elbow of a compliant arm gives way to joint limits. The judge is the simulated motion."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from skiros2_motion.core.geometry import Pose, between, multiplied
from skiros2_motion.core.impedance import LIMIT_TORQUE, limit_repulsion
from skiros2_sim.core.scene_spec import SceneSpec
from skiros2_sim.core.world import World
from support.moved_robot import MovedRobot
from support.simulated_cell import fixed_panda


@pytest.fixture
def arm() -> Iterator[MovedRobot]:
    with World(SceneSpec((), (fixed_panda(),)), rate=500) as world:
        robot = MovedRobot(world)
        robot.controller.switch("compliant")
        robot.controller.stiffness = (800.0,) * 3 + (60.0,) * 3
        yield robot


def test_elbow_keeps_a_joint_away_from_its_limit_and_the_tool_arrives(arm: MovedRobot) -> None:
    start, half = arm.controller.tool_pose(), 2.34 / 2.0
    x, y, z = start.position
    turned = multiplied(start.orientation, (0.0, 0.0, math.sin(half), math.cos(half)))
    goal = Pose((x + 0.19, y - 0.01, z - 0.11), turned)
    kinematics, margins = arm.controller.kinematics, []
    for tick in range(80):
        arm.controller.set_reference(between(start, goal, min(1.0, tick / 40.0)))
        arm.world.step(50)
        positions = np.array(arm.arm.positions())
        margins.append(np.minimum(positions - kinematics.lower, kinematics.upper - positions).min())
    assert min(margins) > 0.05, "without repulsion, joint 7 runs into its limit"
    assert math.dist(arm.controller.tool_pose().position, goal.position) < 0.001, "it was off by 8 mm"


def test_joints_are_repelled_near_their_limits_only() -> None:
    lower, upper = np.array([-1.0, -3.0, -3.0]), np.array([1.0, 3.0, 3.0])
    torques = limit_repulsion(np.array([-1.0, 0.0, 2.8]), lower, upper)
    assert torques[:2].tolist() == [LIMIT_TORQUE, 0.0]
    assert -LIMIT_TORQUE / 2.0 < torques[2] < 0.0
