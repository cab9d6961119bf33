"""Removal of redundant steps."""

from __future__ import annotations

import threading

import pytest
from hypothesis import given

from skiros2_common.core.world_element import Element
from skiros2_task.core.engines import FoundPlan, Limits, Outcome, PlannerAnswer
from skiros2_task.core.formula import disjunction, holds
from skiros2_task.core.plan import make_plan
from skiros2_task.core.planning import TaskPlanner
from skiros2_task.core.reduction import reduced
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep, validate
from support.planning_world import DRIVE, REQUIRED, PlanningWorld, prop, related, skill
from support.random_tasks import planned_tasks
from support.transport_task import at, contain, transport_task

R, G = "cora:Robot-0", "rparts:GripperEffector-0"
A, B, C = (f"skiros:Location-{i}" for i in range(3))
P = "skiros:Product-0"


def drive(start: str, target: str) -> PlanStep:
    return PlanStep("drive", (R, start, target))


PICK, PLACE = PlanStep("pick", (R, G, A, P)), PlanStep("place", (R, G, B, P))
BRING = (PICK, drive(A, B), PLACE)


@pytest.mark.parametrize(
    "plan",
    [
        (drive(A, C), drive(C, A), *BRING),  # there and back
        (PICK, drive(A, C), drive(C, A), drive(A, B), PLACE),
        (*BRING, drive(B, C)),  # after the goal is reached
        (PICK, PlanStep("place", (R, G, A, P)), *BRING),
        (drive(A, C), drive(C, B), drive(B, A), *BRING, drive(B, C), drive(C, A)),  # a round trip of three
    ],
)
def test_redundant_steps_are_removed(plan: tuple[PlanStep, ...]) -> None:
    task = transport_task(1, 3, 1)
    assert validate(task, plan) == ""
    assert reduced(task, plan) == BRING


def test_plan_without_redundant_steps_is_unchanged() -> None:
    assert reduced(transport_task(1, 3, 1), BRING) == BRING


def test_plan_for_satisfied_goal_becomes_empty() -> None:
    task = transport_task(1, 3, 1, goal=at(R, A))
    assert reduced(task, (drive(A, B), drive(B, A))) == ()


def test_one_alternative_of_goal_is_kept() -> None:
    task = transport_task(1, 3, 1, goal=disjunction([at(R, C), contain(B, P)]))
    plan = (*BRING, drive(B, C))
    found = reduced(task, plan)
    assert len(found) < len(plan)
    assert validate(task, found) == ""


class GivenPlan:
    """A planner that knows one plan."""

    name = "given plan"

    def __init__(self, *plan: PlanStep) -> None:
        self._plan = plan

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        return PlannerAnswer(Outcome.SOLVED, (FoundPlan("given", self._plan),))


def test_repeated_step_is_removed_from_result() -> None:
    world = PlanningWorld()
    start, table = world.thing("skiros:Location"), world.thing("skiros:Location")
    look = skill(
        "Look",
        [("Place", "skiros:Location", REQUIRED)],
        pre=[related("Robot", "skiros:at", "Place")],
        post=[prop("Place", "skiros:Seen", "=", True)],
    )
    robot = world.robot("alpha", DRIVE, look, at=start)
    looks = [PlanStep("look", (robot, start)), PlanStep("look", (robot, table)), PlanStep("look", (robot, table))]
    planner = GivenPlan(looks[0], PlanStep("drive", (robot, start, table)), *looks[1:])
    result = TaskPlanner(world.wm, planner, Limits()).plan(f"(skiros:Seen {table})")
    assert [call.label for call in result.calls] == ["drive", "look"]


def _without(task: PlanningTask, plan: tuple[PlanStep, ...], index: int) -> tuple[PlanStep, ...] | None:
    """The plan without a step and the later ones that then cannot run; None when the goal does not hold then."""
    state, kept = task.init, []
    for number, step in enumerate(plan):
        if number != index and holds(task.ground(step).precondition, state):
            kept.append(step)
            state = task.ground(step).apply(state)
    return tuple(kept) if holds(task.goal, state) else None


@given(planned_tasks(most=8))
def test_reduced_plan_is_valid_and_minimal(
    drawn: tuple[PlanningTask, tuple[PlanStep, ...]],
) -> None:
    task, plan = drawn
    found = reduced(task, plan)
    assert validate(task, found) == ""
    left = iter(plan)
    assert all(step in left for step in found), "the order has changed"
    for index in range(len(found)):
        assert validate(task, found[:index] + found[index + 1 :]) != ""
        assert _without(task, found, index) is None


@given(planned_tasks(most=8))
def test_scheduled_plan_has_no_redundant_steps(drawn: tuple[PlanningTask, tuple[PlanStep, ...]]) -> None:
    task, plan = drawn
    found = make_plan(task, plan, Durations(), {name: Element() for name in task.objects}).order.steps
    assert validate(task, found) == ""
    for index in range(len(found)):
        assert _without(task, found, index) is None
