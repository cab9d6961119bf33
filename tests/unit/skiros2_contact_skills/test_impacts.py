"""Contacts in physics at speeds that were too high: the arm slows down, and a peak above the limit is reported."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_contact_skills.contact_motions import move_until_contact
from skiros2_contact_skills.force_motions import apply_force, hold_pose
from skiros2_contact_skills.free_motions import approach_target
from skiros2_motion.core.geometry import IDENTITY, Pose
from skiros2_std_reasoners.core import spatial_data as space
from support.contact_cell import TABLE_TOP, ContactCell, contact_cell
from support.simulated_cell import bench

#: Limit of the force (N), and the largest peak that is tolerated.
LIMIT, TOLERATED = 40.0, 48.0
X, Y = 0.55, 0.3  # beside the tray


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[ContactCell]:
    with contact_cell(bench(), move_until_contact, apply_force, hold_pose, approach_target) as cell:
        yield cell


@pytest.fixture
def cell(shared_cell: ContactCell) -> ContactCell:
    shared_cell.place((X, Y, TABLE_TOP + 0.02))
    return shared_cell


def test_motion_until_contact_that_is_asked_for_too_fast_a_speed_is_slowed_down_and_says_so(cell: ContactCell) -> None:
    task = cell.run("MoveUntilContact", Speed=0.1)
    assert task.state is State.Success, task.why
    assert cell.peak < TOLERATED
    assert "slowed from 100 to " in task.skill.progress_msg


def test_motion_at_a_permitted_speed_is_not_slowed_down(cell: ContactCell) -> None:
    task = cell.run("MoveUntilContact", Speed=0.005)
    assert task.state is State.Success, task.why
    assert "slowed" not in task.skill.progress_msg


@pytest.mark.parametrize("skill", ["ApplyForce", "HoldPose"])
def test_force_from_above_the_surface_does_not_accelerate_freely(cell: ContactCell, skill: str) -> None:
    cell.run(skill, Force=30.0, MaxDistance=0.05, seconds=4.0)
    assert cell.peak > 5.0, "it reaches the surface"
    assert cell.peak < TOLERATED


def test_force_from_above_the_surface_is_reached_there(cell: ContactCell) -> None:
    task = cell.run("ApplyForce", Force=25.0, MaxDistance=0.05, seconds=6.0)
    assert task.state is State.Success, task.why


def test_approach_that_ends_in_the_surface_hits_it_slowly(cell: ContactCell) -> None:
    cell.place((X, Y, TABLE_TOP + 0.1))
    target = cell.skills.add("skiros:TransformationPose", "target", cell.element, "skiros:hasA")
    space.set_pose(target, Pose((X, Y, TABLE_TOP - 0.3), IDENTITY.orientation))
    cell.skills.wmi.update_element_properties(target)
    task = cell.run("ApproachTarget", Target=target, Height=-0.02, Speed=0.3, seconds=5.0)
    assert cell.peak > 5.0, task.why
    assert cell.peak < TOLERATED
