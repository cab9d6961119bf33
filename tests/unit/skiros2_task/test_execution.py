"""The execution state machine, with failing and lost robots and a changing world."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_common.core.explanation import Explanation
from skiros2_common.core.failure_kind import FailureKind
from skiros2_task.core.execution import ROBOT_TIMEOUT, ExecutionStateMachine
from skiros2_task.core.plan import Step
from skiros2_task.core.planning import Verdict
from skiros2_task.core.step_record import Phase, RestoredState, StepState
from support.fuzz import examples
from support.transport_cell import PLANNING_TIME, STEP_TIME, TransportCell


def states(cell: TransportCell) -> list[tuple[str, StepState]]:
    return [(r.step.call.label, r.state) for r in cell.machine.records.values()]


def test_plan_is_executed_and_goal_is_checked() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run()
    assert cell.end is not None
    assert (cell.end.verdict, cell.end.message) == (Verdict.PLANNED, "the goal is reached")
    assert cell.reached
    done = StepState.SUCCEEDED
    assert states(cell) == [("pick", done), ("drive", done), ("place", done)]
    assert cell.machine.replans == 0


def test_unordered_steps_run_in_parallel() -> None:
    one, two = TransportCell(1, 4, 4), TransportCell(2, 4, 4)
    one.run()
    two.run()
    assert one.reached
    assert two.reached
    assert two.now < 0.7 * one.now


def test_satisfied_goal_ends_without_steps() -> None:
    cell = TransportCell(1, 1, 1)  # the place after the only one is itself
    cell.run()
    assert cell.end is not None
    assert (cell.end.verdict, cell.end.message) == (Verdict.NOTHING_TO_DO, "the goal holds already")


def test_failed_step_causes_replan() -> None:
    failed: list[Step] = []

    def first_place(step: Step) -> bool:
        if step.call.label != "place" or failed:
            return False
        failed.append(step)
        return True

    cell = TransportCell(1, 2, 1, fails=first_place)
    cell.run()
    assert cell.reached
    assert cell.machine.replans == 1
    assert [state for _, state in states(cell)].count(StepState.FAILED) == 1


def test_skill_that_failed_twice_moves_to_other_robot() -> None:
    cell = TransportCell(2, 2, 1, fails=lambda step: step.call.manager == "cora:Robot-0" and step.call.label == "pick")
    cell.run()
    assert cell.reached
    assert cell.machine.replans == 2


@pytest.mark.parametrize("kind", [kind for kind in FailureKind if kind.is_final])
def test_final_failure_ends_the_goal(kind: FailureKind) -> None:
    cell = TransportCell(1, 2, 1, fails=lambda step: step.call.label == "place", kind=kind)
    cell.run()
    assert cell.end is not None
    assert cell.end.verdict is Verdict.FAILED
    assert kind.words in cell.end.message
    assert (cell.plans, cell.machine.replans) == (1, 0)


def test_no_step_starts_after_a_final_failure() -> None:
    cell = TransportCell(2, 4, 4, fails=lambda step: step.number == 1, kind=FailureKind.CONTROLLER)
    cell.run()
    assert cell.end is not None
    assert (cell.end.verdict, cell.plans, len(cell.started)) == (Verdict.FAILED, 1, 2)


def test_goal_is_planned_again_after_a_limit_if_the_task_manager_permits_it() -> None:
    failed = []

    def first_place(step: Step) -> bool:
        if step.call.label != "place" or failed:
            return False
        failed.append(step)
        return True

    for kind, is_reached in ((FailureKind.LIMIT, True), (FailureKind.SENSOR, False)):
        failed.clear()
        cell = TransportCell(1, 2, 1, fails=first_place, kind=kind, replans_after_limit=True)
        cell.run()
        assert cell.reached is is_reached


def test_goal_with_a_final_failure_of_an_earlier_process_ends() -> None:
    before = TransportCell(2, 4, 4, fails=lambda step: step.number == 1, kind=FailureKind.LIMIT)
    before.run(PLANNING_TIME + 1.0)
    number = before.machine.running[0].number
    before.running.pop(number)
    why = (Explanation("execute", "", "", -1, -1, "", kind=FailureKind.LIMIT.value),)
    before.machine.ended(number, False, "30 N", why)
    assert before.machine.phase is Phase.STOPPING
    cell = TransportCell(2, 4, 4)
    cell.machine = ExecutionStateMachine(lambda: cell.now)
    records = tuple(before.machine.records.values())
    cell.machine.restore(RestoredState(records, 0, 1, before.machine.failures))
    cell.machine.resume(cell.task)
    assert cell.machine.phase is Phase.STOPPING


def test_step_that_fails_during_planning_causes_replan() -> None:
    failed: list[Step] = []

    def first_two(step: Step) -> bool:
        failed.append(step)
        return len(failed) <= 2

    cell = TransportCell(2, 4, 4, fails=first_two)
    cell.run()
    assert {step.call.manager for step in failed[:2]} == set(cell.robots), "both robots failed at the same time"
    assert cell.reached
    assert cell.machine.replans == 2
    assert all(fits for _, fits in cell.started)


def test_execution_fails_after_max_replans() -> None:
    cell = TransportCell(1, 2, 1, max_replans=3, fails=lambda step: step.call.label == "pick")
    cell.run()
    assert cell.end is not None
    assert cell.end.verdict is Verdict.FAILED
    assert cell.end.message.endswith("has failed: broken. The goal is given up after 3 other plans.")
    assert len(cell.started) == 4


def test_needed_step_continues_during_replan() -> None:
    cell = TransportCell(2, 4, 2, fails=lambda step: step.number == 1)
    cell.run(until=PLANNING_TIME + STEP_TIME / 2)
    other = next(d.step for d in cell.running.values() if d.step.call.manager == "cora:Robot-1")
    cell.running[other.number].until += STEP_TIME  # it takes long
    cell.run(until=PLANNING_TIME + STEP_TIME * 1.9)
    assert cell.machine.replans == 1
    assert other.number in cell.running
    cell.run()
    assert cell.reached
    assert cell.machine.records[other.number].state is StepState.SUCCEEDED


def test_changed_world_causes_replan_before_a_step_fails() -> None:
    cell = TransportCell(1, 3, 2)
    cell.run(until=PLANNING_TIME + 1.0)
    product = cell.task.members["skiros:Product"][1]
    cell.move(product, cell.task.members["skiros:Location"][2])  # which is where it is to be
    cell.run()
    assert cell.reached
    assert cell.machine.replans == 1
    assert all(fits for _, fits in cell.started)


def test_reason_of_a_replan_is_a_sentence() -> None:
    cell = TransportCell(1, 3, 1, max_replans=0)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    product = cell.task.members["skiros:Product"][0]
    cell.change(frozenset(atom for atom in cell.facts if product not in atom.terms))
    cell.run()
    assert cell.end is not None
    assert cell.end.message == "step 3, place by Robot-0, needs that GripperEffector-0 contains Product-0"


def test_reverted_change_causes_no_replan() -> None:
    cell = TransportCell(1, 3, 2)
    cell.run(until=PLANNING_TIME + 1.0)
    before, product = cell.facts, cell.task.members["skiros:Product"][1]
    cell.move(product, cell.task.members["skiros:Location"][2])
    cell.run(until=PLANNING_TIME + 1.1)
    cell.change(before)
    cell.run()
    assert cell.reached
    assert cell.machine.replans == 0


def test_no_step_of_a_broken_plan_starts_before_the_world_has_settled() -> None:
    cell = TransportCell(1, 3, 2)
    cell.run(until=PLANNING_TIME + STEP_TIME - 0.1)
    product, (_, place, other) = cell.task.members["skiros:Product"][1], cell.task.members["skiros:Location"]
    assert cell.machine.next_planning is None
    cell.move(product, other)
    planning = cell.machine.next_planning
    assert planning is not None
    assert planning.running == cell.machine.running
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.1)
    assert len(cell.started) == 1, "the first step has ended, and the second one waits"
    cell.move(product, place)
    assert cell.machine.next_planning is None
    assert len(cell.started) == 2
    cell.run()
    assert (cell.reached, cell.machine.replans) == (True, 0)


def test_unneeded_running_step_is_stopped() -> None:
    cell = TransportCell(2, 3, 2)
    cell.run(until=PLANNING_TIME + 0.1)
    assert {d.step.call.label for d in cell.running.values()} == {"pick", "drive"}
    product = cell.task.members["skiros:Product"][1]
    cell.move(product, cell.task.members["skiros:Location"][2])
    cell.run()
    assert cell.reached
    assert ("drive", StepState.STOPPED) in states(cell)


def test_steps_of_lost_robot_move_to_others() -> None:
    cell = TransportCell(2, 4, 4)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    cell.lose("cora:Robot-1")  # it was on its way
    cell.run()
    assert cell.reached
    assert any(state is StepState.FAILED for _, state in states(cell))


def test_goal_waits_for_lost_robot() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    cell.lose("cora:Robot-0")
    cell.run(until=cell.now + PLANNING_TIME + 1.0)
    assert cell.machine.phase is Phase.BLOCKED
    cell.find("cora:Robot-0")
    cell.run()
    assert cell.reached


def test_goal_fails_after_robot_timeout() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    cell.lose("cora:Robot-0")
    lost_at = cell.now
    cell.run()
    assert cell.end is not None
    assert cell.end.verdict is Verdict.IMPOSSIBLE
    assert ROBOT_TIMEOUT <= cell.now - lost_at < ROBOT_TIMEOUT + 5


def test_robot_that_is_found_while_a_plan_without_it_is_searched_is_used() -> None:
    cell = TransportCell(1, 2, 1)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    cell.lose("cora:Robot-0")
    assert cell.machine.phase is Phase.PLANNING
    cell.run(until=cell.now + PLANNING_TIME / 2)
    cell.find("cora:Robot-0")
    cell.run()
    assert cell.reached
    assert cell.now < ROBOT_TIMEOUT


def test_goal_is_cancelled_in_each_phase() -> None:
    for moment in (0.1, PLANNING_TIME + 1.0, PLANNING_TIME + 3 * STEP_TIME):
        cell = TransportCell(1, 2, 1)
        cell.run(until=moment)
        cell.tell(cell.machine.cancel())
        cell.run()
        assert cell.end is not None
        if cell.end.verdict is not Verdict.CANCELLED:
            assert cell.reached


# -- interruptions -------------------------------------------------------------------------------------------------


def test_interrupted_goal_stops_its_steps_and_is_planned_for_the_world_after_them() -> None:
    cell = TransportCell(1, 3, 1)
    cell.run(until=PLANNING_TIME + 1.0)
    product, elsewhere = cell.task.members["skiros:Product"][0], cell.task.members["skiros:Location"][2]
    cell.tell(cell.machine.interrupt(frozenset(cell.robots)))
    assert cell.machine.phase is Phase.BLOCKED
    cell.move(product, elsewhere)  # put down by the stopped step
    plans = cell.plans
    cell.run(until=cell.now + 0.2)
    assert (cell.machine.phase, cell.plans) == (Phase.PLANNING, plans + 1)
    cell.run()
    assert cell.reached
    assert [state for _, state in states(cell)][:2] == [StepState.STOPPED, StepState.DROPPED]
    assert cell.machine.replans == 0, "an interruption is not a replacement of a broken plan"
    assert all(fits for _, fits in cell.started)


def test_interruption_stops_only_the_steps_that_use_the_robot() -> None:
    cell = TransportCell(2, 4, 4)
    cell.run(until=PLANNING_TIME + STEP_TIME + 0.5)
    other = next(d.step for d in cell.running.values() if d.step.call.manager == cell.robots[1])
    cell.tell(cell.machine.interrupt(frozenset({cell.robots[0]})))
    cell.run()
    assert cell.reached
    assert cell.machine.records[other.number].state is StepState.SUCCEEDED


def test_plan_in_preparation_is_discarded_by_an_interruption() -> None:
    cell = TransportCell(1, 3, 1)
    cell.run(until=0.1)
    cell.tell(cell.machine.interrupt(frozenset(cell.robots)))
    cell.run(until=PLANNING_TIME + 0.1)
    assert (cell.machine.phase, cell.plans, cell.started) == (Phase.PLANNING, 2, [])
    cell.run()
    assert cell.reached


# -- at random -----------------------------------------------------------------------------------------------------

SIZES = st.tuples(st.integers(1, 3), st.integers(2, 4), st.integers(1, 4))


@given(size=SIZES, failing=st.sets(st.integers(1, 40), max_size=5))
@settings(max_examples=examples(200))
def test_goal_is_reached_despite_failures(size: tuple[int, int, int], failing: set[int]) -> None:
    cell = TransportCell(*size, max_replans=5, fails=lambda step: step.number in failing)
    cell.run()
    assert cell.reached
    assert cell.machine.replans <= len(failing)
    assert cell.plans == 1 + cell.machine.replans
    assert all(fits for _, fits in cell.started), "each step was started where what it needs held"


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["move", "lose", "find", "cancel", "interrupt"]),
        st.floats(0.05, 6.0),
        st.integers(0, 3),
        st.integers(0, 3),
    ),
    max_size=6,
)


@given(size=SIZES, failing=st.sets(st.integers(1, 40), max_size=5), events=EVENTS, max_replans=st.integers(0, 4))
@settings(max_examples=examples(300))
def test_execution_ends_with_true_verdict(
    size: tuple[int, int, int], failing: set[int], events: list[tuple[str, float, int, int]], max_replans: int
) -> None:
    cell = TransportCell(*size, max_replans=max_replans, fails=lambda step: step.number in failing)
    robots, places, products = cell.robots, cell.task.members["skiros:Location"], cell.task.members["skiros:Product"]
    for kind, wait, one, other in events:
        cell.run(until=cell.now + wait)
        if cell.end is not None:
            break
        if kind == "move":
            cell.move(products[one % len(products)], places[other % len(places)])
        elif kind == "lose":
            cell.lose(robots[one % len(robots)])
        elif kind == "find":
            cell.find(robots[one % len(robots)])
        elif kind == "interrupt":
            cell.tell(cell.machine.interrupt(frozenset({robots[one % len(robots)]})))
        else:
            cell.tell(cell.machine.cancel())
    cell.run()
    assert cell.end is not None
    assert not cell.running
    assert cell.machine.replans <= max_replans
    if cell.end.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO):
        assert cell.reached
    for record in cell.machine.records.values():
        assert record.state not in (StepState.WAITING, StepState.RUNNING)
        assert (record.started is None) == (record.state is StepState.DROPPED)
