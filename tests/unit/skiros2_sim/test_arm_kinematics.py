"""Kinematics of a model: forward as in the physics, verified inverse solutions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from skiros2_motion.core.arm_kinematics import ArmKinematics, difference, distances
from skiros2_motion.core.geometry import Pose, from_euler
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.world import World
from support.moved_robot import DOWN
from support.simulated_cell import ARM, ROBOT, cell


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World(cell()) as world:
        yield world


@pytest.fixture(scope="module")
def controller(world: World) -> ArmController:
    return ArmController(world, world.robots[ROBOT], world.arms[ARM])


@pytest.fixture(scope="module")
def chain(controller: ArmController) -> ArmKinematics:
    return controller.kinematics


def postures(chain: ArmKinematics, count: int) -> list[np.ndarray]:
    return list(np.random.default_rng(1).uniform(chain.lower, chain.upper, (count, len(chain.lower))))


def test_forward_kinematics_match_the_physics(world: World, controller: ArmController) -> None:
    arm = controller.arm
    for posture in postures(controller.kinematics, 20):
        for joint, position in zip(arm.joints, posture, strict=True):
            world.physics.set_joint(arm.body, joint.index, position)
        assert distances(controller.kinematics.forward(posture), controller.tool_pose()) < (1e-5, 1e-5)
    world.reset()


def test_jacobian_is_the_derivative(chain: ArmKinematics) -> None:
    step = 1e-6
    for posture in postures(chain, 5):
        jacobian = chain.jacobian(posture)
        for i in range(len(posture)):
            moved = posture.copy()
            moved[i] += step
            change = difference(chain.forward(moved), chain.forward(posture)) / step
            assert change == pytest.approx(jacobian[:, i], abs=1e-4)


def test_solution_reaches_the_pose_within_limits(chain: ArmKinematics) -> None:
    there = 0
    for posture in postures(chain, 60):
        target = chain.forward(posture)
        found = chain.inverse(target, chain.rest)
        off, turned = distances(chain.forward(found.positions), target)
        assert (off, turned) == pytest.approx((found.off, found.turned), abs=1e-6), "it tells how far it is off"
        assert np.all(found.positions >= chain.lower)
        assert np.all(found.positions <= chain.upper)
        there += found.converged
    assert there >= 57, "postures drawn by chance are nearly all reached, those close to limits too"


def test_solution_is_near_the_start_posture(chain: ArmKinematics) -> None:
    here = chain.forward(chain.rest)
    x, y, z = here.position
    found = chain.inverse(Pose((x + 0.02, y, z), here.orientation), chain.rest)
    assert found.converged
    assert np.max(np.abs(found.positions - chain.rest)) < 0.15


def test_inverse_is_deterministic(chain: ArmKinematics) -> None:
    target = Pose((0.5, 0.5, 0.7), from_euler(2.5, 0.3, 1.0))
    first, second = (chain.inverse(target, chain.rest) for _ in range(2))
    assert np.array_equal(first.positions, second.positions)


def test_unreachable_pose_returns_the_nearest_solution(chain: ArmKinematics) -> None:
    shoulder = np.array([0.3, 0.0, 0.39 + 0.333])
    near, far = (chain.inverse(Pose((0.3 + reach, 0.0, 0.723), DOWN), chain.rest) for reach in (1.2, 3.0))
    assert not near.converged
    assert not far.converged
    assert far.off - near.off == pytest.approx(1.8, abs=0.15)
    tool = np.array(chain.forward(far.positions).position)
    assert np.linalg.norm(tool - shoulder) > 0.7, "it is stretched out towards the target"
