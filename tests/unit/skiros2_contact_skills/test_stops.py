"""Stops of an arm in physics: nothing in a task retries them or takes back a controller."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_contact_skills.force_motions import hold_pose
from skiros2_contact_skills.free_motions import retract_after_failure, retract_tool
from skiros2_motion.core.compliant_arm import ArmState
from skiros2_motion.core.wrench_guard import Violation
from skiros2_sim.core.simulated_arm import SimulatedArm
from skiros2_skill.core.skill import ParallelFs, RetryOnFail, SelectorStar, SerialStar, Skill
from skiros2_std_skills.core.controller_use import forget
from support.contact_cell import RATE, TABLE_TOP, TICK_RATE, ContactCell, contact_cell
from support.simulated_cell import GRIPPER, bench


class SwitchAway(SkillDescription):
    """Somebody switches the controllers."""

    def createDescription(self) -> None:
        pass


class switch_away(PrimitiveBase):
    switch = staticmethod(lambda: None)

    def createDescription(self) -> None:
        self.setDescription(SwitchAway(), self.__class__.__name__)

    def execute(self) -> State:
        self.switch()
        return self.success()


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[ContactCell]:
    with contact_cell(bench(), hold_pose, retract_tool, retract_after_failure, switch_away) as cell:
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


@pytest.mark.parametrize("takes", [True, False], ids=["foreign", "own"])
def test_controller_that_somebody_switches_off_between_two_skills_is_not_taken_back(
    cell: ContactCell, takes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = cell.robot.controller

    def switch() -> None:
        controller.switch("position")
        if not takes:  # as a skill of the task that switches
            forget(cell.element.id)

    monkeypatch.setattr(switch_away, "switch", staticmethod(switch))
    retract = {"Arm": cell.element, "Height": 0.01}
    nodes = [cell.skills.node("RetractTool", **retract) for _ in range(2)]
    task = cell.skills.task(Skill("", SerialStar())(nodes[0], cell.skills.node("SwitchAway"), nodes[1]))
    tick(cell, task, 4.0)
    if not takes:
        assert task.state is State.Success, task.why
        return
    assert task.state is State.Failure
    assert not controller.compliant
    assert (task.cause().label, task.cause().failure_kind) == ("retract_tool", FailureKind.CONTROLLER)
    again = cell.skills.command("RetractTool", **retract)
    tick(cell, again, 3.0)
    assert again.state is State.Success, "the next task takes it"


@pytest.mark.parametrize("next_goal", ["goal", "other"])
def test_controller_that_somebody_switches_off_between_two_steps_of_a_goal_is_not_taken_back(
    cell: ContactCell, next_goal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = cell.robot.controller
    assert step(cell, "goal", monkeypatch).state is State.Success
    controller.switch("position")
    second = step(cell, next_goal, monkeypatch)
    if next_goal == "other":
        assert second.state is State.Success, second.why
        return
    assert not controller.compliant
    assert (second.cause().label, second.cause().failure_kind) == ("retract_tool", FailureKind.CONTROLLER)


def test_stop_between_two_steps_of_a_goal_is_not_cleared(cell: ContactCell, monkeypatch: pytest.MonkeyPatch) -> None:
    assert step(cell, "goal", monkeypatch).state is State.Success
    cell.world.push(GRIPPER, (0.0, 0.0, 90.0), duration=0.15)
    cell.world.step(RATE)
    assert cell.robot.controller.stop is not None
    second = step(cell, "goal", monkeypatch)
    assert (second.cause().label, second.cause().failure_kind) == ("retract_tool", FailureKind.LIMIT)
    assert step(cell, "goal", monkeypatch).state is State.Success, "a retreat after it"


class AnsweringLate(SimulatedArm):
    """Has no state until its driver has answered, as an adapter over ROS after `end`."""

    answers_at = 0.0

    def state(self) -> ArmState:
        return None if self.now() < self.answers_at else super().state()  # type: ignore[return-value]


def test_stop_between_two_steps_is_not_cleared_before_the_driver_has_answered(
    cell: ContactCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = cell.robot.controller
    arm = AnsweringLate(controller)
    monkeypatch.setattr(cell, "compliant", arm)
    assert step(cell, "goal", monkeypatch).state is State.Success
    controller._stop(Violation("force", 55.0, 40.0))
    arm.answers_at = arm.now() + 0.1
    second = step(cell, "goal", monkeypatch)
    assert second.state is State.Failure, "the stop is lost"
    assert (second.cause().label, second.cause().failure_kind) == ("retract_tool", FailureKind.LIMIT)
    assert controller.stop is not None
    assert step(cell, "goal", monkeypatch).state is State.Success, "a retreat after it"
    arm.answers_at = arm.now() + 0.1
    assert step(cell, "goal", monkeypatch).state is State.Success, "without a stop it waits for the answer"


def test_step_that_is_preempted_before_it_knows_of_a_stop_leaves_the_stop_to_the_next_one(
    cell: ContactCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    hit_after_a_step(cell, monkeypatch)
    second = cell.skills.command("RetractTool", Arm=cell.element, Height=0.01)
    tick(cell, second, 0.04)
    second.preempt()
    second.tick()
    third = step(cell, "goal", monkeypatch)
    assert (third.cause().label, third.cause().failure_kind) == ("retract_tool", FailureKind.LIMIT)


def test_retreat_clears_a_stop_that_has_ended_a_skill_before_it_had_the_arm(
    cell: ContactCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    hit_after_a_step(cell, monkeypatch)
    hold = cell.skills.node("HoldPose", Arm=cell.element)
    hit = cell.skills.node("SwitchAway")  # fails, as a hold-condition that measures the force
    monkeypatch.setattr(switch_away, "execute", lambda self: self.fail("hit", -2, FailureKind.LIMIT))
    retract = cell.skills.node("RetractAfterFailure", Arm=cell.element, Height=0.01)
    task = cell.skills.task(Skill("", SelectorStar())(Skill("", ParallelFs())(hold, hit), retract))
    tick(cell, task, 4.0)
    assert [why.label for why in task.explanations()] == ["retract_after_failure", "switch_away"]
    assert cell.robot.controller.stop is None, "the arm has moved back"


def test_step_does_not_fail_for_a_state_that_was_late_once(cell: ContactCell, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = SimulatedArm(cell.robot.controller)
    monkeypatch.setattr(cell, "compliant", arm)
    assert step(cell, "goal", monkeypatch).state is State.Success
    late = arm.state()._replace(stopped="no state for 0.6 s", kind=FailureKind.SENSOR)
    states, measured = [late], arm.state
    monkeypatch.setattr(arm, "state", lambda: states.pop() if states else measured())
    cell.robot.controller.set_limits(120.0, 50.0)
    second = step(cell, "goal", monkeypatch)
    assert second.state is State.Success, second.why
    assert cell.robot.controller.limits.force == 40.0, "that of the step, not of the one before"


def hit_after_a_step(cell: ContactCell, patch: pytest.MonkeyPatch) -> None:
    """The arm is stopped after a step has succeeded; the driver says so 0.1 s later."""
    arm = AnsweringLate(cell.robot.controller)
    patch.setattr(cell, "compliant", arm)
    assert step(cell, "goal", patch).state is State.Success
    cell.robot.controller._stop(Violation("force", 55.0, 40.0))
    arm.answers_at = arm.now() + 0.1


def step(cell: ContactCell, goal: str, patch: pytest.MonkeyPatch) -> Any:
    """Runs a task that is a step of a goal."""
    patch.setattr(cell.skills, "goal", goal)
    task = cell.skills.command("RetractTool", Arm=cell.element, Height=0.01)
    tick(cell, task, 4.0)
    return task


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
