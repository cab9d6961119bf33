"""Engines of unified-planning as planners."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping

from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.engine_worker import PLAN_FILE, EngineCall, Job
from skiros2_task.core.planner import Limits, PlannerAnswer
from skiros2_task.core.task import PlanningTask

DEFAULT_ENGINE = "fast-downward"


class UpPlanner:
    """A planner that runs one engine of unified-planning."""

    def __init__(
        self, processes: EngineProcesses, engine: str = DEFAULT_ENGINE, options: Mapping[str, str] | None = None
    ) -> None:
        """
        :param processes: where it runs; planners may share them.
        :param engine: the name by which unified-planning knows it, or `module:Class`. An unknown one is told by the
            first answer.
        :param options: the engine's own, such as `{"fast_downward_alias": "lama-first"}`.
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
