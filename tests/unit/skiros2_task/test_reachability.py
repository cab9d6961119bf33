"""Why there is no plan."""

from __future__ import annotations

from skiros2_task.core.formula import And, Not, Or, conjunction
from skiros2_task.core.reachability import explain, explore
from skiros2_task.core.simulation import after
from skiros2_task.core.task import PlanStep
from support.transport_task import at, contain, transport_task

R, G, A, B, P = (
    "cora:Robot-0",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Product-0",
)


def test_all_that_a_plan_reaches_is_found() -> None:
    task = transport_task(1, 2, 1)
    reached = explore(task, 10.0)
    state = task.init
    for step in (
        PlanStep("pick", (R, G, A, P)),
        PlanStep("drive", (R, A, B)),
        PlanStep("place", (R, G, B, P)),
    ):
        assert state <= reached.true
        state = after(task, state, step)
    assert state <= reached.true
    assert reached.complete


def test_a_reachable_goal_needs_no_explanation() -> None:
    assert explain(transport_task(1, 3, 2)) == []


def test_a_goal_that_no_skill_brings_about_is_named() -> None:
    goal = conjunction([contain(B, P), contain(P, B)])
    (why,) = explain(transport_task(1, 2, 1, goal))
    assert why.startswith("(skiros:contain skiros:Product-0 skiros:Location-1) cannot be reached")
    assert "skiros:Location-1 is no skiros:Product" in why


def test_the_condition_that_a_skill_lacks_is_named() -> None:
    # Without a robot nobody can be at the place.
    (why,) = explain(transport_task(0, 2, 1))
    assert "skiros:Place (place) cannot bring it about: it needs (can place ?Robot)" in why


def test_what_must_not_hold_and_never_stops_is_named() -> None:
    owned = next(a for a in transport_task(1, 2, 1).init if a.predicate.name == "skiros:hasA")
    (why,) = explain(transport_task(1, 2, 1, Not(owned)))
    assert why == f"(not {owned}) cannot be reached: no skill brings it about"


def test_what_must_not_hold_may_stop_holding() -> None:
    assert explain(transport_task(1, 2, 1, And((Not(at(R, A)), Or((at(R, A), at(R, B))))))) == []


def test_without_time_nothing_is_claimed() -> None:
    assert explain(transport_task(1, 2, 1), seconds=-1.0) is None
