"""What the execution of a goal consists of, and what it asks to be done."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from skiros2_common.core.explanation import Explanation
from skiros2_task.core.jobs import Job
from skiros2_task.core.task_planner import Verdict


class Phase(Enum):
    """Where the execution of a goal is."""

    PLANNING = "planning"
    BLOCKED = "blocked"
    WAITING = "waiting"
    RUNNING = "running"
    CHECKING = "checking"
    STOPPING = "stopping"
    ENDED = "ended"


class JobState(Enum):
    """What has become of a step."""

    WAITING = "waiting"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"
    DROPPED = "dropped"


# -- what is to be done ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plan:
    """Make a plan, and answer with `planned` or `no_plan`.

    :param running: what runs, and is to be taken as done.
    :param gone: the managers that are not there.
    :param avoided: (manager, label) of skills to plan without if possible.
    """

    running: tuple[Job, ...]
    gone: frozenset[str]
    avoided: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Claim:
    """The robots and devices that are wanted from now on; answer with `granted` as soon as all are free.

    :param in_use: what of it is in use.
    """

    wanted: frozenset[str]
    in_use: frozenset[str]


@dataclass(frozen=True)
class Start:
    """Start a step, and answer with `ended`."""

    job: Job


@dataclass(frozen=True)
class Stop:
    """Stop a step that runs; it answers with `ended`."""

    number: int


@dataclass(frozen=True)
class Look:
    """Look at the world after so many seconds, and answer with `world`."""

    after: float = 0.0


@dataclass(frozen=True)
class Wake:
    """Answer with `wake` after so many seconds."""

    after: float


@dataclass(frozen=True)
class End:
    """It has ended. `verdict` is `PLANNED` when the goal was reached."""

    verdict: Verdict
    message: str


Command = Plan | Claim | Start | Stop | Look | Wake | End


@dataclass
class Record:
    """What became of a step.

    :param began, ended: by the clock of the executive (s); None: not yet.
    """

    job: Job
    state: JobState = JobState.WAITING
    message: str = ""
    explanations: tuple[Explanation, ...] = ()
    began: float | None = None
    ended: float | None = None
