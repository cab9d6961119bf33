"""Plans of a recording are made again, also those after failures and changes of the scene."""

from __future__ import annotations

import pytest

from skiros2_bags.testing.plans import compare_plans, recorded_plans
from skiros2_bags.testing.recording import Recording
from skiros2_task.core.plan import Plan
from skiros2_task.core.planning import PlanningResult, TaskPlanner
from support.ros import ROOT

WORKSPACE = ROOT / "skiros2_std_lib/demos/pick_and_place/owl"


@pytest.fixture(scope="module")
def disturbed() -> Recording:
    """The product is moved, and slips: two plans follow the first one."""
    return Recording(ROOT / "tests" / "bags" / "simulated_disturbed.bag")


def test_plans_after_disturbances_are_numbered_and_start_at_one(disturbed: Recording) -> None:
    plans = recorded_plans(disturbed)
    assert [plan.number for plan in plans] == [1, 2, 3]
    assert all([step["number"] for step in plan.steps] == list(range(1, len(plan.steps) + 1)) for plan in plans)
    assert str(plans[1]).endswith(", plan 2")


def test_plans_after_disturbances_are_the_recorded_ones(disturbed: Recording) -> None:
    found = compare_plans(disturbed, WORKSPACE)
    assert not (found.worse or found.different or found.not_compared), found


def test_worse_plan_after_a_disturbance_is_found(disturbed: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine, longer = TaskPlanner.plan, Plan.makespan.fget  # type: ignore[attr-defined]
    goals = []

    def plan(self: TaskPlanner, goal: str, **more: object) -> PlanningResult:
        goals.append(goal)
        if len(goals) == 2:
            monkeypatch.setattr(Plan, "makespan", property(lambda plan: longer(plan) + 0.5))
        return genuine(self, goal, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(TaskPlanner, "plan", plan)
    worse = compare_plans(disturbed, WORKSPACE).worse
    assert len(worse) == 2
    assert ", plan 2: recorded " in worse[0] and ", plan 3: recorded " in worse[1]
