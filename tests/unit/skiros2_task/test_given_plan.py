"""Given plans, such as approved ones: they run as they are, or are refused with what has changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.given_plan import plan_data, read_given_plan
from skiros2_task.core.planners import engine_planner
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from support.planning_world import PlanningWorld, transport_world
from unit.skiros2_task.test_executor import Cell, cell

__all__ = ["cell"]

Make = Callable[..., Cell]


def goal_of(world: PlanningWorld) -> str:
    return f"(forall (?p - skiros:Product) (skiros:contain {world.places[-1]} ?p))"


def made(world: PlanningWorld, processes: EngineProcesses) -> tuple[TaskPlanner, list[dict[str, Any]]]:
    planner = TaskPlanner(world.wm, engine_planner(processes), Limits(30.0))
    result = planner.plan(goal_of(world))
    assert result.plan is not None, result.message
    return planner, plan_data(result.plan)


def given(planner: TaskPlanner, world: PlanningWorld, steps: Any) -> PlanningResult:
    return planner.plan(goal_of(world), planner=read_given_plan(json.dumps(steps)))


@pytest.mark.parametrize("size", [(1, 2, 1), (2, 3, 4), (3, 4, 3)])
def test_given_plan_is_the_plan_of_an_unchanged_world(processes: EngineProcesses, size: tuple[int, int, int]) -> None:
    world = transport_world(*size)
    planner, steps = made(world, processes)
    result = given(planner, world, steps)
    assert result.plan is not None, result.message
    assert plan_data(result.plan) == steps


def test_given_plan_is_not_improved(processes: EngineProcesses) -> None:
    world = transport_world(2, 3, 4)
    planner, steps = made(world, processes)
    for step in steps:  # one after the other
        step["after"] = [step["number"] - 1] if step["number"] > 1 else []
    result = given(planner, world, steps)
    assert result.plan is not None
    assert [step["after"] for step in plan_data(result.plan)] == [step["after"] for step in steps]


def test_plan_that_does_not_work_any_more_is_refused_with_what_has_changed(processes: EngineProcesses) -> None:
    world = transport_world(1, 2)
    planner, steps = made(world, processes)
    product, start = world.products[0], world.places[0]
    world.wm.set_relation(start, "skiros:contain", product, False)
    result = given(planner, world, steps)
    assert (result.verdict, result.plan) == (Verdict.FAILED, None)
    assert "no longer works" in result.message and product in result.message
    world.wm.set_relation(world.places[-1], "skiros:contain", product, True)
    assert given(planner, world, steps).verdict is Verdict.NOTHING_TO_DO
    other = transport_world(1, 2)
    assert given(made(other, processes)[0], other, []).verdict is Verdict.FAILED  # nothing had to be done before


@pytest.mark.parametrize(
    "change",
    [
        {"robot": "/other"},
        {"label": "other"},
        {"skill": "skiros:Other"},
        {"arguments": {}},
        {"action": ["dance"]},
        {"action": ["drive"]},
    ],
)
def test_step_that_would_run_something_else_is_refused(processes: EngineProcesses, change: dict[str, Any]) -> None:
    world = transport_world(1, 2)
    planner, steps = made(world, processes)
    steps[0] |= change
    assert given(planner, world, steps).verdict is Verdict.FAILED


def test_order_that_is_not_safe_is_refused(processes: EngineProcesses) -> None:
    world = transport_world(1, 2)
    planner, steps = made(world, processes)
    for step in steps:
        step["after"] = []
    result = given(planner, world, steps)
    assert result.verdict is Verdict.FAILED and "would have to wait" in result.message


@pytest.mark.parametrize(
    "text", ["[", "[1]", '[{"action": ["a"]}]', "[" * 10_000, '[{"number": NaN}]', '{"action": []}', "[null]"]
)
def test_text_that_is_no_plan_is_refused(text: str) -> None:
    with pytest.raises(WrongValue):
        read_given_plan(text)


def test_given_plan_is_executed_and_never_replaced(cell: Make, processes: EngineProcesses) -> None:
    one = cell(2, 3, 4)
    _, steps = made(one.world, processes)
    plan = read_given_plan(json.dumps(steps))
    request = one.achieve(planner=plan, max_replans=0)
    assert request.end.verdict is Verdict.PLANNED
    run = {(r.step.number, r.step.call.manager, r.step.call.label) for r in request.execution.started}
    assert run == {(step["number"], step["robot"], step["label"]) for step in steps}
    assert one.reached

    other = cell(1, 2, seconds=0.2)
    _, steps = made(other.world, processes)
    request = other.achieve(planner=read_given_plan(json.dumps(steps)), max_replans=0)
    other.step_runner.wait_for_starts(1)
    other.move(other.world.products[0], other.world.places[0], other.world.places[1])
    assert request.end.verdict is Verdict.FAILED
    assert "step 1" in request.end.message
    assert (request.execution.machine.replans, len(request.execution.started)) == (0, 1)
