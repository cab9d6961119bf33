"""What a planner is to the rest: a task in, an answer out. "No plan" is an answer with a reason, not an exception."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from skiros2_task.core.task import PlanningTask, PlanStep


class Outcome(Enum):
    """How a planner's run ended."""

    SOLVED = "solved"
    IMPOSSIBLE = "proven impossible"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    FAILED = "failed"


@dataclass(frozen=True)
class Limits:
    """What a run may use.

    :param seconds: wall-clock time.
    :param memory_mb: address space of each of its processes (MiB), by default half of the machine's memory; None: no
        limit.
    """

    seconds: float = 60.0
    memory_mb: int | None = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") >> 21


@dataclass(frozen=True)
class PlannerAnswer:
    """What a run gave.

    :param plan: the steps, when solved.
    :param reason: in words, why there is no plan; "" when solved.
    :param log: what the planner printed.
    :param files: the PDDL of domain and problem, where it was written, and the plan in its names; by file name.
    :param seconds: how long the run took, all included.
    """

    outcome: Outcome
    plan: tuple[PlanStep, ...] = ()
    reason: str = ""
    log: str = ""
    files: tuple[tuple[str, str], ...] = ()
    seconds: float = 0.0


class Planner(Protocol):
    """Solves planning tasks. Any thread may call it; calls do not wait for each other."""

    @property
    def name(self) -> str:
        """What it is called."""

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Blocks until there is an answer, the limits are reached or `cancelled` is set."""
