"""The catalogue of domains with known verdicts and shortest plans."""

from __future__ import annotations

import pytest

from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.planners import Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from support.plan_checks import CheckedPlanner, carry_out, is_known
from support.planning_catalogue import CASES, IMPOSSIBLE, Case

NAMES = [case.name for case in CASES]


def answer(case: Case, processes: EngineProcesses, quality: Quality) -> PlanningResult:
    """Plans a case. The plan is validated and executed on a copy of the world."""
    world, goal = case.build()
    planner = CheckedPlanner(planner_named(processes, quality.value), goal_action=quality is Quality.OPTIMAL)
    result = TaskPlanner(world.wm, planner, Limits(seconds=60.0)).plan(goal)
    if result.verdict is Verdict.PLANNED and is_known(world, result.calls):
        after = carry_out(world, result.calls)
        assert TaskPlanner(after.wm, planner, Limits()).plan(goal).verdict is Verdict.NOTHING_TO_DO
    return result


def expected(case: Case) -> Verdict:
    return {0: Verdict.NOTHING_TO_DO, IMPOSSIBLE: Verdict.IMPOSSIBLE}.get(case.steps, Verdict.PLANNED)


@pytest.mark.parametrize("case", CASES, ids=NAMES)
def test_known_case_has_known_verdict(case: Case, processes: EngineProcesses) -> None:
    result = answer(case, processes, Quality.FIRST)
    assert result.verdict is expected(case), result.message
    assert len(result.calls) >= max(0, case.steps)
    assert len({call.manager for call in result.calls}) >= (case.managers if result.calls else 0)


@pytest.mark.parametrize("case", [c for c in CASES if c.steps > 0], ids=[c.name for c in CASES if c.steps > 0])
def test_optimal_plan_has_known_length(case: Case, processes: EngineProcesses) -> None:
    result = answer(case, processes, Quality.OPTIMAL)
    assert result.verdict is Verdict.PLANNED, result.message
    assert len(result.calls) == case.steps, result.message
