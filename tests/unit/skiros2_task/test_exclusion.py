"""Which facts can never hold at the same time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.exclusion import Exclusion, exclusion
from skiros2_task.core.formula import And, Atom, Kind, Predicate, conjunction
from skiros2_task.core.reachability import Patience, explore
from skiros2_task.core.simulation import after
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.why import UNREACHABLE, no_plan
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


def found(task: PlanningTask) -> Exclusion:
    together = exclusion(task, explore(task, Patience(10.0)), Patience(10.0))
    assert together is not None
    return together


def test_a_robot_is_in_one_place_and_a_product_in_one_thing() -> None:
    together = found(transport_task(2, 3, 2))
    assert together.excluded(at(R, A), at(R, B))
    assert together.excluded(contain(A, P), contain(B, P))
    assert together.excluded(contain(G, P), contain(B, P))
    assert not together.excluded(at(R, A), at(S, B))
    assert not together.excluded(at(R, C), contain(B, P))
    assert not together.excluded(at(R, B), at(R, B))


def test_what_a_plan_brings_about_is_never_excluded() -> None:
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
        state = after(task, state, step)
        assert not [(a, b) for a in state for b in state if together.excluded(a, b)]


def test_a_fact_that_never_comes_about_is_excluded_with_all() -> None:
    together = found(transport_task(1, 2, 1))
    assert together.excluded(contain(P, A), at(R, A))
    assert together.excluded(contain(P, A), contain(P, A))


def test_parts_of_a_goal_that_exclude_each_other_are_told() -> None:
    why = no_plan(transport_task(1, 3, 1, conjunction([at(R, B), contain(B, P), at(R, C)])), "timed out")
    assert why.excluded == [[str(at(R, B)), str(at(R, C))]]
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


def test_a_part_that_needs_what_excludes_each_other_is_told() -> None:
    task, met = with_meeting(transport_task(1, 3, 1))
    assert met in explore(task, Patience(10.0)).true
    (fact,) = no_plan(task, "proven impossible").goals
    assert (fact.text, fact.state) == (str(met), UNREACHABLE)
    assert fact.note.startswith("skiros:Meet (meet) would need ")
    assert fact.note.endswith("which can never hold together")


def test_a_fact_that_may_hold_has_no_obstacle() -> None:
    with pytest.raises(LookupError):
        found(transport_task(1, 2, 1)).obstacle(at(R, B))


def test_without_time_nothing_is_said() -> None:
    task = transport_task(1, 2, 1)
    reached = explore(task, Patience(10.0))
    assert exclusion(task, reached, Patience(-1.0)) is None
    assert exclusion(task, explore(task, Patience(-1.0)), Patience(10.0)) is None
