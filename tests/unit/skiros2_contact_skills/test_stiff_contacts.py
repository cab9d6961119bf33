"""Flat, stiff fingers of other arms on a table, in physics: the default speed keeps the true force within the limit,
and a peak above it is no success."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_motions import move_until_contact
from skiros2_contact_skills.contact_primitive import CONTACT_STIFFNESS, OVERSHOT
from skiros2_motion.core.impact import DEFAULT_STIFFNESS
from support.contact_cell import TABLE_TOP, ContactCell, contact_cell
from support.insertion_cells import bench_of

#: Limit of the force (N), exceeded by a fifth at most.
TOLERATED = 40.0 * 1.2
PLACES = ((0.55, 0.3), (0.55, -0.3), (0.5, -0.25))


@pytest.fixture(scope="module", params=["iiwa", "xarm6"])
def cell(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ContactCell]:
    folder: Path = tmp_path_factory.mktemp("arm")
    with contact_cell(bench_of(request.param, folder), move_until_contact) as cell:
        yield cell


def touch(cell: ContactCell, place: tuple[float, float], **params: Any) -> Any:
    cell.place((*place, TABLE_TOP + 0.02))
    cell.robot.controller.zero_sensor()
    return cell.run("MoveUntilContact", **params)


def believe(cell: ContactCell, stiffness: float) -> None:
    cell.element.setProperty(CONTACT_STIFFNESS, stiffness)
    cell.skills.wmi.update_element_properties(cell.element)


@pytest.mark.parametrize("place", PLACES)
def test_default_speed_keeps_the_true_force_within_the_limit(cell: ContactCell, place: tuple[float, float]) -> None:
    task = touch(cell, place)
    assert task.state is State.Success, task.why
    assert 3.0 < cell.peak < TOLERATED


@pytest.mark.parametrize("place", PLACES)
def test_peak_that_the_sensor_shows_in_part_is_reported(cell: ContactCell, place: tuple[float, float]) -> None:
    """The arm is wrong about what it meets: it believes that it is soft."""
    believe(cell, 100e3)
    try:
        task = touch(cell, place, Speed=0.05)
    finally:
        believe(cell, DEFAULT_STIFFNESS)
    (peak,) = task.skill.params["PeakForce"].values
    assert peak == pytest.approx(cell.peak, rel=0.1)
    assert cell.peak > TOLERATED, "a hard hit"
    assert task.state is State.Failure
    assert task.skill.progress_code == OVERSHOT or "has stopped" in task.why
