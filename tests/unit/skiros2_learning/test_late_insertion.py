"""Insertions whose ticks and commands are late, as on a loaded machine, in physics. The judge is the true force of the
contacts with the hand in each step."""

from __future__ import annotations

import math
from collections.abc import Iterator
from random import Random

import pytest

from skiros2_learning.local import insertion_study
from skiros2_learning.local.insertion_study import ARM, InsertionStudy
from skiros2_motion.core.geometry import Pose
from skiros2_sim.core.arm import Arm
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.simulated_arm import SimulatedArm

pytestmark = [pytest.mark.timeout(600), pytest.mark.long]

#: Limit of the force (N), exceeded by a fifth at most.
LIMIT = 40.0 * 1.2
#: One tick of five is late, by one of these times (s); each reference is late by up to LATE_COMMAND.
PART, LATE_TICKS, LATE_COMMAND = 0.2, (0.1, 0.3, 0.5, 1.0), 0.1
#: For all attempts of the skill (s).
TIME_LIMIT = 180.0


class TrueForce:
    """Measures the largest force. A motion of the world."""

    outcome = None
    most = 0.0

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def update(self, dt: float) -> None:
        """Called before each step."""
        self.most = max(self.most, math.hypot(*self._arm.wrench()[:3]))


class LateArm(SimulatedArm):
    """Follows a reference after a random time. A motion of the world."""

    outcome = None

    def __init__(self, controller: ArmController) -> None:
        super().__init__(controller)
        self._random = Random(5)
        self._waiting: list[tuple[float, Pose]] = []
        controller.world.motions.add(self)

    def set_reference(self, pose: Pose) -> None:
        self._waiting.append((self.now() + self._random.uniform(0.0, LATE_COMMAND), pose))

    def update(self, dt: float) -> None:
        """Called before each step."""
        while self._waiting and self._waiting[0][0] <= self.now():
            super().set_reference(self._waiting.pop(0)[1])


@pytest.fixture(scope="module")
def study() -> Iterator[InsertionStudy]:
    with InsertionStudy() as study:
        yield study


@pytest.mark.parametrize("seed", range(1, 7))
@pytest.mark.parametrize("late_commands", [False, True], ids=["ticks", "ticks and commands"])
def test_force_stays_within_the_limit_when_ticks_are_late(
    study: InsertionStudy, seed: int, late_commands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if late_commands:
        monkeypatch.setattr(insertion_study, "SimulatedArm", LateArm)
    random = Random(seed)
    forces: list[TrueForce] = []

    def disturb(study: InsertionStudy, seconds: float) -> None:
        if not forces:  # a run resets the world at its start
            forces.append(TrueForce(study.world.arms[ARM]))
            study.world.motions.add(forces[0])
        if random.random() < PART:
            study.world.step(round(study.world.rate * random.choice(LATE_TICKS)))

    run = study.run(seed, 0.002, math.radians(1.0), disturb=disturb, time_limit=TIME_LIMIT)
    print(f"{forces[0].most:.1f} N, {run.max_force:.1f} N at the wrist, {run.time:.1f} s, {run.why}")
    assert run.reported is run.success, run.why  # the part may turn in the fingers: the skill notices it
    assert 5.0 < max(forces[0].most, run.max_force) < LIMIT
