"""Motions are planned a little in each step of the world, in simulated time that does not depend on the machine."""

from __future__ import annotations

import time

import pytest

from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_motion.core.motion import Motion, State
from skiros2_sim.core.scene_spec import BodySpec
from skiros2_sim.core.world import World
from support.moved_robot import MovedRobot
from support.simulated_cell import bench, cell

OUT_OF_REACH = (2.0, 0.0, 0.6)
AMONG_POSTS = (-5.0, -10.0)
#: s of CPU time of the stepping thread; planning the motions of this file takes several times as long in total.
MOST_PER_STEP = 0.05


def crowded_cell() -> World:
    """A mobile robot at the edge of 36 posts."""
    world = World(cell())
    for x in range(-8, 4, 2):
        for y in range(-13, -2, 2):
            at = Pose((float(x), float(y), 0.3), IDENTITY.orientation)
            world.add_body(BodySpec(f"test:Post-{x}{y}", pose=at, size=(0.15, 0.15, 0.6)))
    return world


def longest_step(world: World, motion: Motion, steps: int) -> float:
    """Returns the CPU time of the longest of some steps (s)."""
    world.step(5)
    world.motions.add(motion)
    longest = 0.0
    for _ in range(steps):
        start = time.thread_time()
        world.step()
        longest = max(longest, time.thread_time() - start)
    return longest


def test_inverse_kinematics_do_not_hold_up_the_world() -> None:
    with World(bench()) as world:
        motion = MovedRobot(world).line(OUT_OF_REACH)
        assert motion.outcome is None
        assert longest_step(world, motion, 60) < MOST_PER_STEP
        assert motion.outcome is not None
        assert motion.outcome.state is State.ABORTED


def test_path_search_does_not_hold_up_the_world() -> None:
    with crowded_cell() as world:
        robot = MovedRobot(world)
        motion = robot.drive(*AMONG_POSTS)
        assert longest_step(world, motion, 240) < MOST_PER_STEP
        assert robot.robot.velocity() != pytest.approx((0.0, 0.0, 0.0), abs=0.01), "it drives by now"


def test_planning_takes_the_same_simulated_time_in_each_run() -> None:
    def run() -> list[tuple[int, Pose]]:
        with crowded_cell() as world:
            robot = MovedRobot(world)
            world.motions.add(robot.drive(*AMONG_POSTS))
            poses = []
            for _ in range(24):
                world.step(10)
                poses.append((world.steps, robot.robot.pose()))
            return poses

    first, second = run(), run()
    assert first == second
    assert first[0][1] != first[-1][1], "it drives by now"


def test_cancelled_planning_ends_without_motion() -> None:
    with World(bench()) as world:
        robot = MovedRobot(world)
        world.step(60)
        before = robot.arm.positions()
        motion = robot.line((0.5, -0.3, 0.7))
        world.motions.add(motion)
        world.step()
        motion.cancel()
        assert motion.outcome is not None
        assert motion.outcome.state is State.PREEMPTED
        world.step(10)
        assert robot.arm.positions() == pytest.approx(before, abs=1e-4)
