"""Commands of the execution state machine, and the records of the steps that it executes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.planning import Verdict
from skiros2_task.core.steps import Step


class Phase(Enum):
    """A state of the execution state machine."""

    PLANNING = "planning"
    BLOCKED = "blocked"
    WAITING = "waiting"
    RUNNING = "running"
    CHECKING = "checking"
    STOPPING = "stopping"
    ENDED = "ended"


class StepState(Enum):
    """The state of a step."""

    WAITING = "waiting"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"
    DROPPED = "dropped"


# -- commands --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plan:
    """Make a plan; answered by `planned` or `no_plan`.

    :param running: steps that run, whose effects are assumed.
    :param lost: the managers that do not run.
    :param avoided: (manager, skill label) pairs to plan without if possible.
    """

    running: tuple[Step, ...]
    lost: frozenset[str]
    avoided: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Claim:
    """Request these robots and devices, in place of the last request; answered by `granted` once all are free.

    :param in_use: the requested ones that running steps use.
    """

    requested: frozenset[str]
    in_use: frozenset[str]


@dataclass(frozen=True)
class Start:
    """Start a step; answered by `ended`."""

    step: Step


@dataclass(frozen=True)
class Stop:
    """Stop a running step; answered by `ended`."""

    number: int


@dataclass(frozen=True)
class ReadWorld:
    """Read the world model after `delay` (s); answered by `world`."""

    delay: float = 0.0


@dataclass(frozen=True)
class Wake:
    """Call `wake` after `delay` (s)."""

    delay: float


@dataclass(frozen=True)
class End:
    """The execution has ended. `verdict` is `PLANNED` if the goal was reached."""

    verdict: Verdict
    message: str


Command = Plan | Claim | Start | Stop | ReadWorld | Wake | End


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
