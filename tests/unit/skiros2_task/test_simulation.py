"""Plans carried out on a task's facts."""

from __future__ import annotations

import pytest

from skiros2_task.core.simulation import after, flaw
from skiros2_task.core.task import PlanStep
from support.transport_task import at, contain, transport_task

R, G, A, B, P = (
    "cora:Robot-0",
    "rparts:GripperEffector-0",
    "skiros:Location-0",
    "skiros:Location-1",
    "skiros:Product-0",
)
PLAN = (PlanStep("pick", (R, G, A, P)), PlanStep("drive", (R, A, B)), PlanStep("place", (R, G, B, P)))
TASK = transport_task(1, 2, 1)


def test_a_plan_that_leads_to_the_goal_has_no_flaw() -> None:
    assert flaw(TASK, PLAN) == ""


def test_a_step_changes_what_its_effects_say_and_nothing_else() -> None:
    state = after(TASK, TASK.init, PLAN[1])
    assert state == (TASK.init - {at(R, A)}) | {at(R, B)}


def test_what_a_step_makes_both_true_and_false_is_true() -> None:
    assert at(R, A) in after(TASK, TASK.init, PlanStep("drive", (R, A, A)))


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ((), f"at the end {contain(B, P)} does not hold"),
        (PLAN[:2], "at the end"),
        (PLAN[1:], "step 2 (place"),
        ((PlanStep("fly", (R, A, B)),), "step 1: there is no action 'fly'"),
        ((PlanStep("drive", (R, A)),), "expected 3 arguments"),
        ((PlanStep("drive", (R, A, P)),), "skiros:Product-0 is no skiros:Location"),
        ((PlanStep("drive", (R, A, "nowhere")),), "nowhere is no skiros:Location"),
    ],
)
def test_a_flaw_is_named_with_its_step(plan: tuple[PlanStep, ...], expected: str) -> None:
    assert expected in flaw(TASK, plan)
