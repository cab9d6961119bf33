"""The frames of a robot to publish on tf."""

from __future__ import annotations

import pytest

from skiros2_motion.core.geometry import IDENTITY, Pose, composed
from skiros2_sim.core.world import World
from skiros2_sim.ros.frames import Frames
from support.simulated_cell import ARM, ROBOT

NAME = "mobile_manipulator"
BASE = f"{NAME}/base_link"


class Told:
    """What a listener of tf knows: the last pose of each frame in its parent."""

    def __init__(self, world: World) -> None:
        self._frames = Frames(world)
        self.world = world
        self._poses: dict[str, tuple[str, Pose]] = {}

    def go_on(self) -> set[str]:
        """Asks what has moved; the names of the frames."""
        told = {name: (parent, pose) for parent, name, pose in self._frames.moved(self.world)}
        self._poses |= told
        return set(told)

    def in_map(self, name: str) -> Pose:
        if name == "map":
            return IDENTITY
        parent, pose = self._poses[name]
        return composed(self.in_map(parent), pose)

    def is_right(self) -> bool:
        for link, pose in self.world.robots[ROBOT].link_poses().items():
            assert self.in_map(f"{NAME}/{link}").position == pytest.approx(pose.position, abs=1e-4)
        return True


def test_first_call_yields_all_frames(world: World) -> None:
    told = Told(world)
    links = {f"{NAME}/{link}" for link in world.robots[ROBOT].link_poses()}
    assert told.go_on() == links | {f"{NAME}/odom"}
    assert told.is_right()


def test_later_calls_yield_moved_frames_only(world: World) -> None:
    told = Told(world)
    told.go_on()
    world.set_pose(ROBOT, Pose((0.5, -0.3, 0.0), IDENTITY.orientation))
    assert told.go_on() == {BASE}
    assert told.is_right()
    arm = world.arms[ARM]
    arm.drive([position + 0.2 for position in arm.positions()])
    world.step(60)
    moved = told.go_on()
    assert f"{NAME}/arm/tool" in moved
    assert not any("wheel" in frame for frame in moved)
    assert told.is_right()


def test_frames_are_correct_after_a_reset(world: World) -> None:
    told = Told(world)
    arm = world.arms[ARM]
    arm.drive([position + 0.2 for position in arm.positions()])
    world.step(60)
    told.go_on()
    world.reset()
    told.go_on()
    assert told.is_right()
