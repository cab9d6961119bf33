"""Mutex facts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.explain_no_plan import UNREACHABLE, explain_no_plan
from skiros2_task.core.formula import And, Atom, Kind, Predicate, conjunction
from skiros2_task.core.mutex import Mutexes, find_mutexes
from skiros2_task.core.reachability import Deadline, explore
from skiros2_task.core.semantics import apply_step
from skiros2_task.core.task import PlanningTask, PlanStep
from support.transport_task import at, contain, transport_task

R, S, G, A, B, C, P, Q = (
    "cora:Robot-0",
    "cora:Robot-1",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Location-2",
    "skiros:Product-0",
    "skiros:Product-1",
)


def found(task: PlanningTask) -> Mutexes:
    together = find_mutexes(task, explore(task, Deadline(10.0)), Deadline(10.0))
    assert together is not None
    return together


def test_locations_of_robot_are_mutex() -> None:
    together = found(transport_task(2, 3, 2))
    assert together.are_mutex(at(R, A), at(R, B))
    assert together.are_mutex(contain(A, P), contain(B, P))
    assert together.are_mutex(contain(G, P), contain(B, P))
    assert not together.are_mutex(at(R, A), at(S, B))
    assert not together.are_mutex(at(R, C), contain(B, P))
    assert not together.are_mutex(at(R, B), at(R, B))


def test_facts_reached_together_are_not_mutex() -> None:
    task = transport_task(1, 3, 2)
    together = found(task)
    state = task.init
    for step in (
        PlanStep("pick", (R, G, A, P)),
        PlanStep("drive", (R, A, B)),
        PlanStep("place", (R, G, B, P)),
        PlanStep("pick", (R, G, B, Q)),
        PlanStep("drive", (R, B, C)),
    ):
        state = apply_step(task, state, step)
        assert not [(a, b) for a in state for b in state if together.are_mutex(a, b)]


def test_unreachable_fact_is_mutex_with_all_facts() -> None:
    together = found(transport_task(1, 2, 1))
    assert together.are_mutex(contain(P, A), at(R, A))
    assert together.are_mutex(contain(P, A), contain(P, A))


def test_mutex_goal_parts_are_reported() -> None:
    why = explain_no_plan(transport_task(1, 3, 1, conjunction([at(R, B), contain(B, P), at(R, C)])), "timed out")
    assert why.mutex == [[str(at(R, B)), str(at(R, C))]]
    assert why.verdict == "proven impossible"
    assert f"{at(R, B)} and {at(R, C)} can never hold together" in str(why).splitlines()


def with_meeting(task: PlanningTask) -> tuple[PlanningTask, Atom]:
    """The task with a skill that needs the robot in two places."""
    met = Atom(Predicate(Kind.VALUE, "skiros:Met", True), (R,))
    drive = task.action("drive")
    needs = And((at("?Robot", "?Place"), at("?Robot", "?To"), at("?Robot", B), at("?Robot", C)))
    effect = Effect(Atom(met.predicate, ("?Robot",)), True)
    meet = Action(
        "meet", replace(drive.skill, type="skiros:Meet", label="meet"), "?Robot", (), drive.variables, needs, (effect,)
    )
    return replace(task, actions=(*task.actions, meet), goal=met), met


def test_goal_part_with_mutex_needs_is_reported() -> None:
    task, met = with_meeting(transport_task(1, 3, 1))
    assert met in explore(task, Deadline(10.0)).true
    (fact,) = explain_no_plan(task, "proven impossible").goals
    assert (fact.text, fact.state) == (str(met), UNREACHABLE)
    assert fact.note.startswith("skiros:Meet (meet) would need ")
    assert fact.note.endswith("which can never hold together")


def test_reachable_fact_has_no_obstacle() -> None:
    with pytest.raises(LookupError):
        found(transport_task(1, 2, 1)).obstacle(at(R, B))


def test_find_mutexes_returns_none_after_deadline() -> None:
    task = transport_task(1, 2, 1)
    reached = explore(task, Deadline(10.0))
    assert find_mutexes(task, reached, Deadline(-1.0)) is None
    assert find_mutexes(task, explore(task, Deadline(-1.0)), Deadline(10.0)) is None
