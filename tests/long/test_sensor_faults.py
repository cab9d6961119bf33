"""Faults of the force sensor at random times of contact skills in physics: no contact is far above the limit, and an
arm that stops is at rest soon. `FAULTS` sets the number of injections for each skill and fault."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from skiros2_contact_skills.contact_motions import move_until_contact, spiral_search
from skiros2_learning.local import insertion_study
from skiros2_learning.local.insertion_study import InsertionStudy
from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.wrist_sensor import EXACT, SensorModel
from support.contact_cell import RATE, TABLE_TOP, TICK_RATE, ContactCell, contact_cell
from support.fault_watch import AFTER, FAULTS, REST_SPEED, FaultWatch, Result, row
from support.simulated_cell import bench

pytestmark = [pytest.mark.long, pytest.mark.timeout(7200)]

COUNT, SEED = int(os.environ.get("FAULTS", "20")), 28
#: Default limit of the force, and the largest true force that is tolerated (N).
LIMIT = 40.0
TOLERATED = 1.5 * LIMIT
NOISY = SensorModel(force_noise=0.1, torque_noise=0.005)


@pytest.fixture(scope="module")
def studies() -> Iterator[dict[bool, InsertionStudy]]:
    with InsertionStudy(sensor=NOISY) as noisy, InsertionStudy(sensor=EXACT) as exact:
        yield {True: noisy, False: exact}


def in_cell(cell: ContactCell, skill: str, fault: str, wait: float) -> Result:
    """A skill above the table (`MoveUntilContact`, until 20 N), or on it (`SpiralSearch`, with 10 N)."""
    is_search = skill == "SpiralSearch"
    cell.place((0.55, 0.3, TABLE_TOP + (0.0005 if is_search else 0.006)))
    cell.robot.controller.zero_sensor()
    watch = FaultWatch(cell.world, cell.robot.controller, fault, wait, lambda: True)
    cell.world.motions.add(watch)
    more = {"Force": 10.0} if is_search else {"ContactForce": 20.0, "Speed": 0.03}
    cell.run(skill, seconds=wait + AFTER, is_done=lambda: watch.has_ended, **more)
    while not watch.has_ended:
        cell.world.step(RATE // TICK_RATE)
    watch.close()
    return watch.result


class _Ended(Exception):
    """Ends a run whose fault was observed."""


def in_bore(study: InsertionStudy, fault: str, wait: float, seed: int) -> Result:
    """An insertion with an error of 1 mm; the fault comes some time after the piston has entered the bore."""
    watches: list[FaultWatch] = []

    def controller_of(*given: Any) -> ArmController:
        controller = ArmController(*given)
        entered = lambda: controller.compliant and study.part_in_bore()[0] > 0.003  # noqa: E731
        watches.append(FaultWatch(study.world, controller, fault, wait, entered))
        study.world.motions.add(watches[0])
        return controller

    def end(study: InsertionStudy, seconds: float) -> None:
        if watches[0].has_ended:
            raise _Ended

    with pytest.MonkeyPatch.context() as patch, suppress(_Ended):
        patch.setattr(insertion_study, "ArmController", controller_of)
        study.run(seed=seed, position_error=0.001, time_limit=10.0, disturb=end)
    while watches[0].is_injected and not watches[0].has_ended:
        study.world.step(RATE // TICK_RATE)
    watches[0].close()
    return watches[0].result


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(("skill", "longest"), [("MoveUntilContact", 0.8), ("SpiralSearch", 2.0), ("InsertPart", 1.5)])
def test_fault_of_the_sensor_is_followed_by_no_high_force_and_a_stop_by_rest(
    studies: dict[bool, InsertionStudy], skill: str, longest: float, fault: str
) -> None:
    is_noisy = FAULTS[fault][2]
    waits = np.random.default_rng(SEED).uniform(0.0, longest, COUNT).tolist()
    if skill == "InsertPart":
        results = [in_bore(studies[is_noisy], fault, wait, seed) for seed, wait in enumerate(waits)]
    else:
        sensor = NOISY if is_noisy else EXACT
        with contact_cell(bench(), move_until_contact, spiral_search, sensor=sensor) as cell:
            results = [in_cell(cell, skill, fault, wait) for wait in waits]
    print(row(skill, fault, results))
    assert max(result.peak for result in results) <= TOLERATED
    assert max(result.speed for result in results) <= REST_SPEED
    if is_noisy:
        assert max(result.delay for result in results) < 0.1, "each is found"
