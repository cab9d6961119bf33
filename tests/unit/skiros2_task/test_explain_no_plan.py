"""Explanations why there is no plan."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_task.core.compiler import make_task
from skiros2_task.core.engines import Outcome
from skiros2_task.core.explain_no_plan import (
    HOLDS,
    REACHABLE,
    UNKNOWN,
    UNREACHABLE,
    Fact,
    NoPlan,
    explain_no_plan,
)
from skiros2_task.core.formula import FALSE, And, Atom, Formula, Kind, Not, Or, Predicate, conjunction
from skiros2_task.core.goal_reader import GoalReader
from skiros2_task.core.reachability import Deadline
from skiros2_task.core.task import PlanningTask
from skiros2_task.core.unusable_skills import unusable_skills
from skiros2_task.core.world import WorldView
from support.planning_world import DRIVE, PICK, PLACE, REQUIRED, PlanningWorld, prop, skill, transport_world
from support.transport_task import AT, HAS_A, at, contain, transport_task

R, G, A, B, P = (
    "cora:Robot-0",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Product-0",
)


def impossible(task: PlanningTask, **options: Any) -> NoPlan:
    return explain_no_plan(task, Outcome.IMPOSSIBLE, **options)


def without(task: PlanningTask, predicate: Predicate) -> PlanningTask:
    """The task without all facts of a predicate."""
    return replace(task, init=frozenset(atom for atom in task.init if atom.predicate != predicate))


def of_world(world: PlanningWorld, goal: str) -> NoPlan:
    view = WorldView(world.wm)
    task = make_task(view, GoalReader(view, set()).read(goal))
    return impossible(task, left_out=unusable_skills(view, task))


def test_unreachable_goal_parts_come_first() -> None:
    goal = conjunction([at(R, A), at(R, B), contain(P, B)])
    why = impossible(transport_task(1, 2, 1, goal))
    assert [(fact.text, fact.state) for fact in why.goals] == [
        (str(contain(P, B)), UNREACHABLE),
        (str(at(R, B)), REACHABLE),
        (str(at(R, A)), HOLDS),
    ]
    assert why.unreachable == why.goals[:1]


def test_elements_of_wrong_class_are_obstacles() -> None:
    (fact,) = impossible(transport_task(1, 2, 1, contain(P, B))).goals
    place = next(a for a in fact.achievers if a.skill == "skiros:Place (place)")
    assert place.values == {"Place": P, "Object": B}
    assert place.obstacles == [
        f"needs a location for Place, but {P} is a product",
        f"needs a product for Object, but {B} is a location",
    ]


def test_nearest_binding_is_explained_to_missing_fact() -> None:
    why = impossible(without(transport_task(1, 2, 1), HAS_A))
    (fact,) = why.goals
    (place,) = fact.achievers
    assert place.skill == "skiros:Place (place)"
    assert place.values == {"Robot": R, "Gripper": G, "Place": B, "Object": P}
    owned, held = place.unsatisfied
    assert (owned.text, owned.note) == (f"(skiros:hasA {R} {G})", "no skill achieves it")
    assert held.text == str(contain(G, P))
    (pick,) = held.achievers
    assert pick.skill == "skiros:Pick (pick)"
    assert [(f.text, f.note) for f in pick.unsatisfied] == [(owned.text, "see above")]
    assert why.missing == [owned.text]


def test_binding_with_fewest_unsatisfied_conditions_is_chosen() -> None:
    # The second robot is at no place, the first one only lacks its gripper.
    task = transport_task(2, 2, 1)
    gone = {Atom(HAS_A, (R, G)), at("cora:Robot-1", A), Atom(HAS_A, ("cora:Robot-1", "rparts:GripperEffector-1"))}
    why = impossible(replace(task, init=task.init - gone))
    assert why.goals[0].achievers[0].values["Robot"] == R


def test_circular_fact_is_missing() -> None:
    # A robot that is nowhere cannot drive.
    why = impossible(without(transport_task(1, 2, 1, at(R, B)), AT))
    (drive,) = why.goals[0].achievers
    assert why.missing
    assert all(text.startswith(f"(skiros:at {R} ") for text in why.missing)
    assert drive.unsatisfied


def test_robot_without_skill_is_reported() -> None:
    can_place = Predicate(Kind.CAN, "place")
    why = impossible(without(transport_task(1, 2, 1), can_place))
    (lacking,) = why.goals[0].achievers[0].unsatisfied
    assert (lacking.text, lacking.note) == (f"{R} has the skill place", "its manager does not offer it")


def test_missing_class_of_elements_is_reported() -> None:
    (fact,) = impossible(transport_task(0, 2, 1)).goals
    assert "needs a robot for Robot, but the scene has none" in fact.achievers[0].obstacles


def test_permanent_fact_in_negated_goal_is_reported() -> None:
    owned = Atom(HAS_A, (R, G))
    why = impossible(transport_task(1, 2, 1, Not(owned)))
    (fact,) = why.goals
    assert (fact.text, fact.note) == (f"(not {owned})", "no skill achieves it")


@pytest.mark.parametrize(
    "goal", [And((at(R, B), Not(at(R, B)))), And((Or((at(R, B), contain(B, P))), Not(at(R, B)), Not(contain(B, P))))]
)
def test_contradictory_goal_parts_are_reported(goal: Formula) -> None:
    facts = impossible(transport_task(1, 2, 1, goal)).goals
    against = [f for f in facts if f.note == "the goal asks for it and for the opposite"]
    assert against
    assert {f.state for f in against} == {UNREACHABLE}


def test_each_alternative_is_explained() -> None:
    (fact,) = impossible(transport_task(1, 2, 1, Or((contain(P, A), contain(P, B))))).goals
    assert fact.note == "no alternative can be reached"
    assert [part.text for part in fact.parts] == [str(contain(P, A)), str(contain(P, B))]


def test_long_disjunction_is_truncated() -> None:
    task = transport_task(1, 6, 1)
    places = task.members["skiros:Location"]
    (fact,) = impossible(replace(task, goal=Or(tuple(contain(P, place) for place in places)))).goals
    assert (len(fact.parts), fact.more) == (3, 3)
    assert fact.text == "(or ...)"


def test_empty_disjunction_is_reported() -> None:
    (fact,) = impossible(transport_task(1, 2, 1, FALSE)).goals
    assert fact.note == "the scene has no element for it"


def test_parts_reachable_only_alone_are_reported() -> None:
    other = "skiros:Location-2"
    goal = And((Or((at(R, B), contain(P, B))), Or((at(R, other), contain(P, other)))))
    why = impossible(transport_task(1, 3, 1, goal))
    assert {fact.state for fact in why.goals} == {REACHABLE}
    assert "but not all parts together" in str(why)


def test_unreachable_goal_overrides_timeout() -> None:
    assert explain_no_plan(transport_task(1, 2, 1, contain(P, B)), Outcome.TIMED_OUT).verdict == "proven impossible"
    assert explain_no_plan(transport_task(1, 2, 1), Outcome.TIMED_OUT).verdict == "timed out"


def test_passed_deadline_gives_unknown_states() -> None:
    why = explain_no_plan(transport_task(1, 2, 1), Outcome.TIMED_OUT, deadline=Deadline(-1.0))
    assert [fact.state for fact in why.goals] == [UNKNOWN]
    assert "the time was too short to find" in str(why)


def test_unusable_helpful_skill_is_reported() -> None:
    world = transport_world(robots=0)
    paint = skill(
        "Paint",
        [("Object", "skiros:Product", REQUIRED)],
        pre=[],
        post=[prop("Object", "skiros:Colour", "=", "red")],
    )
    world.robot("painter", paint, DRIVE, at=world.places[0])
    world.thing("skiros:Product", Colour="red")
    why = of_world(world, f"(red {world.products[0]})")
    (achiever,) = why.goals[0].achievers
    assert achiever.obstacles == ["cannot be planned with: it has no pre-conditions"]
    assert why.left_out == [f"{achiever.skill} of /painter: it has no pre-conditions"]
    assert why.missing == []


def test_skill_without_candidates_is_reported() -> None:
    world = transport_world(robots=0)
    world.robot("handless", DRIVE, PICK, PLACE, at=world.places[0])
    why = of_world(world, f"(skiros:contain {world.places[1]} {world.products[0]})")
    obstacles = {text for achiever in why.goals[0].achievers for text in achiever.obstacles}
    assert obstacles == {"needs a gripper effector for Gripper, but the scene has none"}


def test_text_has_all_levels() -> None:
    why = impossible(without(transport_task(1, 2, 1), HAS_A), reason="search space exhausted")
    lines = str(why).splitlines()
    assert lines[:5] == [
        f"No plan: {R} has {G}: no skill achieves it.",
        "verdict: proven impossible (search space exhausted)",
        f"cannot be reached: {B} contains {P}",
        f"  skiros:Place (place) with Robot={R}, Gripper={G}, Place={B}, Object={P} needs",
        f"    cannot be reached: {R} has {G} (no skill achieves it)",
    ]


def test_no_plan_json_round_trip() -> None:
    why = impossible(without(transport_task(1, 2, 1), HAS_A))
    assert NoPlan.from_json(why.to_json()) == why
    with pytest.raises(WrongValue, match="why there is no plan"):
        NoPlan.from_json("{")
    with pytest.raises(WrongType, match=r"why there is no plan.goals\[0\].more: expected a int, got str"):
        NoPlan.from_dict({"verdict": "failed", "reason": "", "goals": [{"text": "", "state": HOLDS, "more": "x"}]})


def test_unknown_fact_has_own_text() -> None:
    assert list(Fact("(a b)", UNKNOWN, "because").lines()) == ["not known to be reachable: (a b) (because)"]
