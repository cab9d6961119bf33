"""Several ways to plan side by side: what is wished for, and which plan wins."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from enum import Enum

from skiros2_task.core.durations import Durations
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.engine_worker import PLAN_FILE, FoundPlan, Job
from skiros2_task.core.fast_downward import (
    LAMA_FIRST,
    LAZY_GREEDY,
    LAZY_WASTAR,
    OPTIMAL,
    SideBySide,
    shuffled,
)
from skiros2_task.core.planner import Limits, Planner, PlannerAnswer
from skiros2_task.core.schedule import schedule_plan
from skiros2_task.core.simulation import flaw
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.up_planner import DEFAULT_ENGINE, UpPlanner

#: How long a plan takes (s); the least wins.
Cost = Callable[[PlanningTask, Sequence[PlanStep]], float]


class Wish(Enum):
    """What kind of plan is wished for."""

    FIRST = "first"  # as soon as there is one; the best of those that come a little later
    BEST = "best"  # the best that is found in the time
    OPTIMAL = "optimal"  # one with the fewest steps


_WORK = {
    Wish.FIRST: SideBySide((LAMA_FIRST, LAZY_WASTAR, LAZY_GREEDY), patience=0.1),
    Wish.BEST: SideBySide((LAMA_FIRST, LAZY_WASTAR, LAZY_GREEDY, *(shuffled(seed) for seed in range(1, 4)))),
    Wish.OPTIMAL: SideBySide((OPTIMAL,), goal_action=True),
}


class Portfolio:
    """A planner that runs searches of Fast Downward side by side, and gives the best of their plans."""

    def __init__(self, processes: EngineProcesses, wish: Wish, cost: Cost) -> None:
        """
        :param processes: where it runs; planners may share them.
        :param cost: by which plans are compared. All of them are checked before.
        """
        self._processes = processes
        self._wish = wish
        self._cost = cost

    @property
    def name(self) -> str:
        return f"{DEFAULT_ENGINE}, {self._wish.value} plan"

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Solves a task; see `Planner`."""
        started = time.monotonic()
        run = self._processes.run(Job(task, _WORK[self._wish], limits), cancelled or threading.Event())
        best, report = self._best(task, run.answer.plans)
        seconds = time.monotonic() - started
        files = (*run.files, (PLAN_FILE, best.text)) if best else run.files
        plan = best.steps if best else ()
        return PlannerAnswer(run.answer.outcome, plan, run.answer.reason, run.log + report, files, seconds)

    def _best(self, task: PlanningTask, plans: Sequence[FoundPlan]) -> tuple[FoundPlan | None, str]:
        """The best plan, and a line on each. A plan that does not work is given only when there is no other."""
        costs: list[tuple[float, FoundPlan]] = []
        lines = []
        for found in plans:
            wrong = flaw(task, found.steps)
            cost = float("inf") if wrong else self._cost(task, found.steps)
            costs.append((cost, found))
            shown = wrong or f"{len(found.steps)} steps, makespan {cost:g} s"
            lines.append(f"{found.by}, after {found.seconds:.2f} s: {shown}\n")
        if not costs:
            return None, ""
        return min(costs, key=lambda pair: pair[0])[1], "".join(lines)


def makespan(durations: Durations | None = None) -> Cost:
    """A plan's cost by the time that it takes with all robots at work (s).

    :param durations: of the skills; by default each takes as long as any other.
    """
    known = durations or Durations()
    return lambda task, plan: schedule_plan(task, plan, known).makespan


def planner_named(
    processes: EngineProcesses, name: str = DEFAULT_ENGINE, durations: Durations | None = None
) -> Planner:
    """The planner for a wish (`first`, `best`, `optimal`), or of an engine's name.

    :param durations: of the skills; the plan with the smallest makespan wins, where there are several.
    """
    cost = makespan(durations)
    if name == DEFAULT_ENGINE:
        return Portfolio(processes, Wish.FIRST, cost)
    if name in {wish.value for wish in Wish}:
        return Portfolio(processes, Wish(name), cost)
    return UpPlanner(processes, name)
