"""The player of motions on an arm whose tool is where its reference was at the last update."""

from __future__ import annotations

import itertools
from typing import cast

import pytest

from skiros2_motion.core.compliant_arm import ArmState, CompliantArm
from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_teaching.core.player import Player
from skiros2_teaching.core.timed_motion import Limits, Line

DISTANCE = 0.3
_TICK = 0.01


class FollowingArm:
    """The part of an arm that a player uses."""

    def __init__(self) -> None:
        self.time = 0.0
        self.references = [IDENTITY]

    def now(self) -> float:
        return self.time

    def set_reference(self, pose: Pose) -> None:
        self.references.append(pose)

    def state(self) -> ArmState:
        return ArmState(self.references[-1], (0.0,) * 6, self.time)


@pytest.mark.parametrize("pause", [_TICK, 0.5, 3.0])
def test_late_tick_delays_the_motion_without_a_jump_of_the_reference(pause: float) -> None:
    arm = FollowingArm()
    goal = Pose((DISTANCE, 0.0, 0.0), IDENTITY.orientation)
    player = Player(cast(CompliantArm, arm), None, [Line(IDENTITY, goal, Limits(speed=0.2))])
    while not player.has_ended and player.failure is None:
        player.update(arm.state())
        is_midway = 0.4 * DISTANCE < arm.references[-1].position[0] < 0.45 * DISTANCE
        arm.time += pause if is_midway else _TICK
    assert player.failure is None
    positions = [pose.position[0] for pose in arm.references]
    assert positions[-1] == pytest.approx(DISTANCE)
    assert max(b - a for a, b in itertools.pairwise(positions)) < 0.025
