"""Effects of steps and validation of plans."""

from __future__ import annotations

import pytest

from skiros2_task.core.task import PlanStep, validate
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


def test_valid_plan_passes() -> None:
    assert validate(TASK, PLAN) == ""


def test_step_applies_only_its_effects() -> None:
    state = TASK.ground(PLAN[1]).apply(TASK.init)
    assert state == (TASK.init - {at(R, A)}) | {at(R, B)}


def test_add_wins_over_delete() -> None:
    assert at(R, A) in TASK.ground(PlanStep("drive", (R, A, A))).apply(TASK.init)


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ((), f"at the end {contain(B, P)} does not hold"),
        (PLAN[:2], "at the end"),
        (PLAN[1:], "step 2 (place"),
        ((PlanStep("fly", (R, A, B)),), "step 1: there is no action 'fly'"),
        ((PlanStep("drive", (R, A)),), "expected 3 arguments"),
        ((PlanStep("drive", (R, A, P)),), "skiros:Product-0 is not a skiros:Location"),
        ((PlanStep("drive", (R, A, "nowhere")),), "nowhere is not a skiros:Location"),
    ],
)
def test_error_names_step(plan: tuple[PlanStep, ...], expected: str) -> None:
    assert expected in validate(TASK, plan)
