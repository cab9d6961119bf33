"""From a condition that breaks in the middle of a plan to the first step of the new plan, beside a plan alone.

The world has 0.3 s to settle, in which the new plan is searched: the longer of both counts.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from benchmarks.measurement import Measurement, paired
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.goal_execution import Goal, GoalExecution
from skiros2_task.core.planners import Planner, planner_named
from skiros2_task.core.planning import TaskPlanner, Verdict
from support.planning_world import PlanningWorld, transport_world
from support.stand_in_step_runner import StandInStepRunner

RUNS = 5

#: robots, places, products
SIZE = (2, 20, 20)

#: The most that it may take (s).
LIMIT = 0.5

#: What a step takes (s): robots are at work when the world changes.
STEP = 0.2

_LIMITS = Limits(60.0)


def measure() -> Iterator[Measurement]:
    processes = EngineProcesses()
    planner = planner_named(processes)
    try:
        yield paired(
            "broken condition to first step of the new plan, robots/places/products " + "/".join(map(str, SIZE)),
            lambda: _replanned(planner),
            "a plan for that goal alone",
            lambda: _planned(planner),
            unit="s",
            runs=RUNS,
            limit=LIMIT,
        )
    finally:
        processes.close()


def _goal(world: PlanningWorld) -> str:
    return f"(forall (?p - skiros:Product) (skiros:contain {world.places[-1]} ?p))"


def _planned(planner: Planner) -> float:
    world = transport_world(*SIZE)
    start = time.perf_counter()
    result = TaskPlanner(world.wm, planner, _LIMITS).plan(_goal(world))
    if result.verdict is not Verdict.PLANNED:
        raise RuntimeError(f"no plan: {result.message}")
    return time.perf_counter() - start


def _replanned(planner: Planner) -> float:
    world = transport_world(*SIZE)
    step_runner = StandInStepRunner(world, STEP)
    executor = GoalExecutor(TaskPlanner(world.wm, planner, _LIMITS), step_runner)
    step_runner.on_change = executor.world_changed
    again = threading.Event()
    begins = 0

    def on_change(execution: GoalExecution) -> None:
        nonlocal begins
        if execution.machine.replans and execution.machine.plan_start > 1:
            begins = execution.machine.plan_start
            again.set()

    try:
        executor.achieve(Goal(_goal(world)), on_change, lambda execution, end: None)
        step_runner.wait_for_starts(2)
        world.wm.set_relation(world.places[8], "skiros:contain", world.products[8], False)
        world.wm.set_relation(world.places[9], "skiros:contain", world.products[8], True)
        start = time.monotonic()
        executor.world_changed()
        if not again.wait(_LIMITS.seconds):
            raise RuntimeError("no new plan was made")
        return step_runner.wait_for_step(lambda step: step.number >= begins) - start
    finally:
        executor.close()
