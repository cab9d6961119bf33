"""Explanations of the purpose of each step of a plan."""

from __future__ import annotations

from dataclasses import replace

from skiros2_common.core.world_element import Element
from skiros2_task.core.explain_plan import OUTSIDE, Link, WhyPlan, explain_plan
from skiros2_task.core.formula import Formula, conjunction
from skiros2_task.core.partial_order import deorder
from skiros2_task.core.plan import plan_of
from skiros2_task.core.schedule import schedule
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanStep
from support.transport_task import at, contain, transport_task

R, G, A, B, C, P = (
    "cora:Robot-0",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Location-2",
    "skiros:Product-0",
)
PICK, DRIVE, PLACE = PlanStep("pick", (R, G, A, P)), PlanStep("drive", (R, A, B)), PlanStep("place", (R, G, B, P))


def why(*plan: PlanStep, goal: Formula | None = None) -> WhyPlan:
    task = transport_task(1, 3, 1)
    if goal is not None:
        task = replace(task, goal=goal)
    objects = {name: Element("", eid=name) for name in task.objects}
    return explain_plan(plan_of(task, schedule(task, deorder(task, plan), Durations()), objects))


def test_step_serves_consumers_of_its_effects() -> None:
    pick, drive, place = why(PICK, DRIVE, PLACE).steps
    assert pick.serves == [Link(str(contain(G, P)), 3)]
    assert drive.serves == [Link(str(at(R, B)), 3)]
    assert place.serves == [Link(str(contain(B, P)), OUTSIDE)]


def test_step_names_producers_of_its_needs() -> None:
    pick, drive, place = why(PICK, DRIVE, PLACE).steps
    assert Link(str(contain(A, P)), OUTSIDE) in pick.needs
    assert drive.needs == [Link(str(at(R, A)), OUTSIDE)]
    assert sorted(place.needs, key=lambda link: link.step) == [
        Link(str(contain(G, P)), 1),
        Link(str(at(R, B)), 2),
    ]


def test_step_names_goal_parts_it_serves() -> None:
    goal = conjunction([contain(B, P), at(R, C)])
    steps = why(PICK, DRIVE, PLACE, PlanStep("drive", (R, B, C)), goal=goal).steps
    assert [step.goals for step in steps] == [
        [str(contain(B, P))],
        [str(contain(B, P)), str(at(R, C))],
        [str(contain(B, P))],
        [str(at(R, C))],
    ]


def test_redundant_step_and_satisfied_part_are_reported() -> None:
    goal = conjunction([contain(A, P), at(R, B)])
    found = why(PICK, PlanStep("place", (R, G, A, P)), DRIVE, goal=goal)
    assert found.held == [str(contain(A, P))]
    text = str(found)
    assert f"{contain(A, P)} holds already" in text
    assert f"     makes {at(R, B)} for the goal" in text
    superfluous = why(DRIVE, PlanStep("drive", (R, B, C)), goal=contain(A, P))
    assert superfluous.steps[1].serves == []
    assert "no step needs its effects" in str(superfluous)


def test_why_plan_json_round_trip() -> None:
    found = why(PICK, DRIVE, PLACE)
    assert WhyPlan.from_json(found.to_json()) == found
