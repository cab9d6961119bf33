"""The planners, by name: search portfolios for a plan quality, and engines of unified-planning."""

from __future__ import annotations

import threading
from enum import Enum
from typing import Protocol

from skiros2_task.core.engines import EngineCall, EngineProcesses, Job, Limits, PlannerAnswer, Search, SearchPortfolio
from skiros2_task.core.task import PlanningTask

DEFAULT_ENGINE = "fast-downward"


class Quality(Enum):
    """The plan quality asked for."""

    FIRST = "first"  # the first plan, or a better one within a grace period
    BEST = "best"  # the best plan within the time limit
    OPTIMAL = "optimal"  # a plan with the fewest steps


class Planner(Protocol):
    """Solves planning tasks. Thread-safe; calls run concurrently. "No plan" is an answer with a reason."""

    @property
    def name(self) -> str:
        """The name of the planner."""

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Blocks until the task is solved, a limit is reached or `cancelled` is set."""


class EnginePlanner:
    """A planner that runs an engine of unified-planning, or a portfolio of Fast Downward searches."""

    def __init__(self, processes: EngineProcesses, name: str, work: EngineCall | SearchPortfolio) -> None:
        """
        :param processes: may be shared by planners.
        """
        self.name = name
        self._processes = processes
        self._work = work

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Solves a task; see `Planner`."""
        return self._processes.run(Job(task, self._work, limits), cancelled or threading.Event())

    def solve_ahead(self, task: PlanningTask, limits: Limits, cancelled: threading.Event) -> None:
        """Starts to solve a task that `solve` may be asked for soon; see `EngineProcesses.run_ahead`."""
        self._processes.run_ahead(Job(task, self._work, limits), cancelled)

    def discard(self, cancelled: threading.Event) -> None:
        """Ends what `solve_ahead` has started, if anything."""
        self._processes.discard(cancelled)


def engine_planner(processes: EngineProcesses, name: str = DEFAULT_ENGINE, **options: str) -> EnginePlanner:
    """Returns the planner that runs one engine.

    :param name: the engine's name in unified-planning, or `module:Class`. The answers of an unknown one are failures.
    :param options: of the engine, such as `fast_downward_alias="lama-first"`.
    """
    return EnginePlanner(processes, name, EngineCall(name, tuple(options.items())))


def planner_named(processes: EngineProcesses, name: str = DEFAULT_ENGINE) -> EnginePlanner:
    """Returns the planner for a quality (`first`, `best`, `optimal`) or an engine's name."""
    if name == DEFAULT_ENGINE:
        name = Quality.FIRST.value
    if name not in {quality.value for quality in Quality}:
        return engine_planner(processes, name)
    return EnginePlanner(processes, f"{DEFAULT_ENGINE}, {name} plan", _PORTFOLIOS[Quality(name)])


_LAMA_FIRST = Search(
    "lama-first",
    "let(hlm, eval_modify_costs(landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()),pref=false),cost_type=one),"
    "let(hff, eval_modify_costs(ff(),cost_type=one),"
    "lazy_greedy([hff,hlm],preferred=[hff,hlm],cost_type=one,reopen_closed=false)))",
)
_LAZY_WASTAR = Search("lazy-wastar-2", "let(hff, ff(), lazy_wastar([hff],preferred=[hff],w=2))")
_LAZY_GREEDY = Search("lazy-greedy-ff", "let(hff, ff(), lazy_greedy([hff],preferred=[hff]))")
_OPTIMAL = Search("astar-lmcut", "astar(lmcut())")


def _shuffled(seed: int) -> Search:
    """Returns lazy WA* with successors in random order."""
    options = f"preferred=[hff],w=2,randomize_successors=true,random_seed={seed}"
    return Search(f"lazy-wastar-2-seed-{seed}", f"let(hff, ff(), lazy_wastar([hff],{options}))")


_PORTFOLIOS = {
    Quality.FIRST: SearchPortfolio((_LAMA_FIRST, _LAZY_WASTAR, _LAZY_GREEDY), grace_share=0.1),
    Quality.BEST: SearchPortfolio((_LAMA_FIRST, _LAZY_WASTAR, _LAZY_GREEDY, *map(_shuffled, range(1, 4)))),
    Quality.OPTIMAL: SearchPortfolio((_OPTIMAL,), goal_action=True),
}
