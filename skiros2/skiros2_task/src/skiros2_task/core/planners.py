"""The planners, by name: search portfolios for a plan quality, and engines of unified-planning."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from enum import Enum

from skiros2_task.core.durations import Durations
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.engine_worker import PLAN_FILE, EngineCall, FoundPlan, Job
from skiros2_task.core.fast_downward import (
    LAMA_FIRST,
    LAZY_GREEDY,
    LAZY_WASTAR,
    OPTIMAL,
    SearchPortfolio,
    shuffled,
)
from skiros2_task.core.planner import Limits, Planner, PlannerAnswer
from skiros2_task.core.schedule import schedule_plan
from skiros2_task.core.semantics import validate
from skiros2_task.core.task import PlanningTask, PlanStep

DEFAULT_ENGINE = "fast-downward"

#: Returns the cost of a plan; the plan with the lowest cost is chosen.
Cost = Callable[[PlanningTask, Sequence[PlanStep]], float]


class Quality(Enum):
    """The plan quality asked for."""

    FIRST = "first"  # the first plan, or a better one within a grace period
    BEST = "best"  # the best plan within the time limit
    OPTIMAL = "optimal"  # a plan with the fewest steps


_PORTFOLIOS = {
    Quality.FIRST: SearchPortfolio((LAMA_FIRST, LAZY_WASTAR, LAZY_GREEDY), grace_share=0.1),
    Quality.BEST: SearchPortfolio((LAMA_FIRST, LAZY_WASTAR, LAZY_GREEDY, *(shuffled(seed) for seed in range(1, 4)))),
    Quality.OPTIMAL: SearchPortfolio((OPTIMAL,), goal_action=True),
}


class Portfolio:
    """A planner that runs a portfolio of Fast Downward searches and returns the best of their plans."""

    def __init__(self, processes: EngineProcesses, quality: Quality, cost: Cost) -> None:
        """
        :param processes: may be shared by planners.
        :param cost: compares valid plans.
        """
        self._processes = processes
        self._quality = quality
        self._cost = cost

    @property
    def name(self) -> str:
        return f"{DEFAULT_ENGINE}, {self._quality.value} plan"

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Solves a task; see `Planner`."""
        started = time.monotonic()
        run = self._processes.run(Job(task, _PORTFOLIOS[self._quality], limits), cancelled or threading.Event())
        best, report = self._best(task, run.answer.plans)
        seconds = time.monotonic() - started
        files = (*run.files, (PLAN_FILE, best.text)) if best else run.files
        plan = best.steps if best else ()
        return PlannerAnswer(run.answer.outcome, plan, run.answer.reason, run.log + report, files, seconds)

    def _best(self, task: PlanningTask, plans: Sequence[FoundPlan]) -> tuple[FoundPlan | None, str]:
        """Returns the best plan, and a report with a line per plan. An invalid plan is returned only if all are."""
        costs: list[tuple[float, FoundPlan]] = []
        lines = []
        for found in plans:
            wrong = validate(task, found.steps)
            cost = float("inf") if wrong else self._cost(task, found.steps)
            costs.append((cost, found))
            text = wrong or f"{len(found.steps)} steps, makespan {cost:g} s"
            lines.append(f"{found.by}, after {found.seconds:.2f} s: {text}\n")
        if not costs:
            return None, ""
        return min(costs, key=lambda pair: pair[0])[1], "".join(lines)


class UpPlanner:
    """A planner that runs one engine of unified-planning."""

    def __init__(
        self, processes: EngineProcesses, engine: str = DEFAULT_ENGINE, options: Mapping[str, str] | None = None
    ) -> None:
        """
        :param processes: may be shared by planners.
        :param engine: its name in unified-planning, or `module:Class`. The answers of an unknown engine are failures.
        :param options: of the engine, such as `{"fast_downward_alias": "lama-first"}`.
        """
        self._processes = processes
        self._call = EngineCall(engine, tuple((options or {}).items()))

    @property
    def name(self) -> str:
        return self._call.name

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Solves a task; see `Planner`."""
        started = time.monotonic()
        run = self._processes.run(Job(task, self._call, limits), cancelled or threading.Event())
        seconds = time.monotonic() - started
        found = run.answer.plans[0] if run.answer.plans else None
        files = (*run.files, (PLAN_FILE, found.text)) if found else run.files
        plan = found.steps if found else ()
        return PlannerAnswer(run.answer.outcome, plan, run.answer.reason, run.log, files, seconds)


def makespan(durations: Durations | None = None) -> Cost:
    """Returns a cost function: the makespan of a plan (s).

    :param durations: of the skills; by default all equal.
    """
    known = durations or Durations()
    return lambda task, plan: schedule_plan(task, plan, known).makespan


def planner_named(
    processes: EngineProcesses, name: str = DEFAULT_ENGINE, durations: Durations | None = None
) -> Planner:
    """Returns the planner for a quality (`first`, `best`, `optimal`) or an engine's name.

    :param durations: of the skills; of several plans the one with the smallest makespan is chosen.
    """
    cost = makespan(durations)
    if name == DEFAULT_ENGINE:
        return Portfolio(processes, Quality.FIRST, cost)
    if name in {quality.value for quality in Quality}:
        return Portfolio(processes, Quality(name), cost)
    return UpPlanner(processes, name)
