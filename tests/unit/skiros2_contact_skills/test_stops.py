"""Stops of an arm in physics: nothing in a task retries them or takes back a controller."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_contact_skills.force_motions import hold_pose
from skiros2_contact_skills.free_motions import retract_after_failure
from skiros2_skill.core.skill import RetryOnFail, SelectorStar, Skill
from support.contact_cell import RATE, TABLE_TOP, TICK_RATE, ContactCell, contact_cell
from support.simulated_cell import GRIPPER, bench


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[ContactCell]:
    with contact_cell(bench(), hold_pose, retract_after_failure) as cell:
        yield cell


@pytest.fixture
def cell(shared_cell: ContactCell) -> ContactCell:
    shared_cell.place((0.55, 0.3, TABLE_TOP + 0.1))
    return shared_cell


def persistent(cell: ContactCell) -> Any:
    """A task that holds the pose, retracts after a failure, and tries again up to five times."""
    hold = cell.skills.node("HoldPose", Arm=cell.element)
    retract = cell.skills.node("RetractAfterFailure", Arm=cell.element, MaxForce=120.0)  # the hit may not be over
    task = cell.skills.task(Skill("", RetryOnFail(5))(Skill("", SelectorStar())(hold, retract)))
    tick(cell, task, 0.5)
    assert task.state is State.Running
    return task


def tick(cell: ContactCell, task: Any, seconds: float) -> None:
    for _ in range(round(seconds * TICK_RATE)):
        if task.state in (State.Running, State.Idle):
            task.tick()
        cell.world.step(RATE // TICK_RATE)


def test_controller_that_somebody_switches_off_is_not_taken_back_before_the_next_task(cell: ContactCell) -> None:
    controller = cell.robot.controller
    task = persistent(cell)
    controller.switch("position")
    tick(cell, task, 3.0)
    assert task.state is State.Failure
    assert not controller.compliant
    assert (task.cause().label, task.cause().failure_kind) == ("hold_pose", FailureKind.CONTROLLER)
    again = persistent(cell)
    assert controller.compliant
    again.preempt()
    again.tick()


def test_arm_that_is_hit_retracts_once_and_the_task_fails(cell: ContactCell) -> None:
    task = persistent(cell)
    height = cell.compliant.state().pose.position[2]
    cell.world.push(GRIPPER, (0.0, 0.0, 90.0), duration=0.15)
    tick(cell, task, 6.0)
    assert task.state is State.Failure
    assert (task.cause().label, task.cause().failure_kind) == ("hold_pose", FailureKind.LIMIT)
    assert [why.label for why in task.explanations()] == ["retract_after_failure", "hold_pose"]
    assert all(why.times == 1 for why in task.explanations())
    assert cell.compliant.state().pose.position[2] > height + 0.05
