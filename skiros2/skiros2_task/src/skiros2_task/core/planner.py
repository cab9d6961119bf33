"""The interface of planners. "No plan" is an answer with a reason, not an exception."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from skiros2_task.core.task import PlanningTask, PlanStep


class Outcome(Enum):
    """The outcome of a planner run."""

    SOLVED = "solved"
    IMPOSSIBLE = "proven impossible"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    FAILED = "failed"


@dataclass(frozen=True)
class Limits:
    """Limits of a planner run.

    :param seconds: wall-clock time.
    :param memory_mb: address space per process (MiB), by default half of the machine's memory; None: unlimited.
    """

    seconds: float = 60.0
    memory_mb: int | None = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") >> 21


@dataclass(frozen=True)
class PlannerAnswer:
    """The result of a planner run.

    :param plan: the steps, if solved.
    :param reason: why there is no plan; "" if solved.
    :param log: the planner's output.
    :param files: (file name, text) pairs: the PDDL of domain and problem, if written, and the plan in PDDL names.
    :param seconds: the duration of the run.
    """

    outcome: Outcome
    plan: tuple[PlanStep, ...] = ()
    reason: str = ""
    log: str = ""
    files: tuple[tuple[str, str], ...] = ()
    seconds: float = 0.0


class Planner(Protocol):
    """Solves planning tasks. Thread-safe; calls run concurrently."""

    @property
    def name(self) -> str:
        """The name of the planner."""

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Blocks until the task is solved, a limit is reached or `cancelled` is set."""
