"""Schedules of plans."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given

from skiros2_task.core.formula import Atom, Formula, Kind, conjunction, conjuncts
from skiros2_task.core.partial_order import deorder
from skiros2_task.core.schedule import Schedule, Scheduled, schedule, seconds_of
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep, validate
from support.random_tasks import planned_tasks
from support.transport_task import at, contain, transport_task

R, G = ("cora:Robot-0", "cora:Robot-1"), ("rparts:GripperEffector-0", "rparts:GripperEffector-1")
L = ("skiros:Location-0", "skiros:Location-1", "skiros:Location-2")
P = ("skiros:Product-0", "skiros:Product-1")


def scheduled(task: PlanningTask, plan: tuple[PlanStep, ...], durations: Durations) -> Schedule:
    found = schedule(task, deorder(task, plan), durations)
    assert found.bound <= found.makespan + 1e-9
    return found


def bring(robot: int, product: int, start: int, target: int) -> tuple[PlanStep, ...]:
    hand = (R[robot], G[robot])
    return (
        PlanStep("pick", (*hand, L[start], P[product])),
        PlanStep("drive", (R[robot], L[start], L[target])),
        PlanStep("place", (*hand, L[target], P[product])),
    )


def timed(task: PlanningTask) -> Durations:
    """Drive takes 5 s, pick and place 2 s each."""
    durations = Durations()
    for action in task.actions:
        durations.record(action.skill, "", 5.0 if action.name == "drive" else 2.0)
    return durations


def test_step_starts_after_predecessors() -> None:
    task = transport_task(1, 2, 1)
    found = scheduled(task, bring(0, 0, 0, 1), timed(task))
    assert found.steps == (Scheduled(0, R[0], 0.0, 2.0), Scheduled(1, R[0], 2.0, 7.0), Scheduled(2, R[0], 7.0, 9.0))
    assert found.makespan == 9.0


def test_steps_of_two_robots_overlap() -> None:
    task = transport_task(2, 2, 1, conjunction([contain(L[1], P[0]), at(R[1], L[1])]))
    found = scheduled(task, (*bring(0, 0, 0, 1), PlanStep("drive", (R[1], L[0], L[1]))), timed(task))
    assert (found.steps[3].start, found.makespan) == (0.0, 9.0)


def test_empty_plan_has_zero_makespan() -> None:
    task = transport_task(1, 2, 1, conjunction([]))
    assert scheduled(task, (), Durations()).makespan == 0.0


def test_plan_without_capable_robot_is_unchanged() -> None:
    task = transport_task(2, 2, 1)
    able = {a for a in task.init if a.predicate.kind is not Kind.CAN}
    free = [replace(a, precondition=without_can(a.precondition)) for a in task.actions]
    task = replace(task, actions=tuple(free), init=frozenset(able))
    assert scheduled(task, bring(0, 0, 0, 1), timed(task)).makespan == 9.0
    nothing = replace(task, goal=conjunction([]))
    assert scheduled(nothing, (), Durations()).steps == ()


def without_can(formula: Formula) -> Formula:
    return conjunction(p for p in conjuncts(formula) if not isinstance(p, Atom) or p.predicate.kind is not Kind.CAN)


# -- of all plans -----------------------------------------------------------------------------------------------------


@given(planned=planned_tasks())
def test_schedule_is_valid_and_not_longer_than_sequence(
    planned: tuple[PlanningTask, tuple[PlanStep, ...]],
) -> None:
    task, plan = planned
    durations = Durations()
    for number, action in enumerate(task.actions, 1):
        durations.record(action.skill, "/robot-0", float(number))
    found = scheduled(task, plan, durations)
    steps = found.order.steps
    assert validate(task, steps) == ""
    assert validate(task, [steps[s.step] for s in sorted(found.steps, key=lambda s: (s.start, s.end))]) == ""
    spent = [seconds_of(task, step, durations) for step in steps]
    longest: list[float] = []
    for before, seconds in zip(found.order.predecessors(), spent, strict=True):
        longest.append(seconds + max((longest[i] for i in before), default=0.0))
    assert max(longest, default=0.0) <= found.makespan <= sum(seconds_of(task, s, durations) for s in plan)
    assert found == scheduled(task, plan, durations)
