"""The execution of single steps."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.plan import Step


class StepState(Enum):
    """The state of a step."""

    WAITING = "waiting"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"
    DROPPED = "dropped"


@dataclass
class StepRecord:
    """The execution of a step.

    :param started, ended: by the clock of the state machine (s); None: not yet.
    """

    step: Step
    state: StepState = StepState.WAITING
    message: str = ""
    explanations: tuple[Explanation, ...] = ()
    started: float | None = None
    ended: float | None = None


@dataclass(frozen=True)
class RestoredState:
    """The state of an execution that an earlier process has begun.

    :param failures: how often each skill has failed, by (manager, skill label).
    """

    records: tuple[StepRecord, ...]
    replans: int
    plan_start: int
    failures: Counter[tuple[str, str]]
