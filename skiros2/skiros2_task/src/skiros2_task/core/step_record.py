"""The phases of an execution, and the execution of single steps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from skiros2_common.core.explanation import Explanation, worst_kind
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.wording import label_text, with_names
from skiros2_task.core.commands import End
from skiros2_task.core.plan import Step
from skiros2_task.core.planning import Verdict


class Phase(Enum):
    """A state of the execution state machine."""

    PLANNING = "planning"
    BLOCKED = "blocked"
    WAITING = "waiting"
    RUNNING = "running"
    CHECKING = "checking"
    STOPPING = "stopping"
    ENDED = "ended"
    ASKING = "asking"


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
    :param task: the number of its task on the robot's manager; -1 while it is not known.
    """

    step: Step
    state: StepState = StepState.WAITING
    message: str = ""
    explanations: tuple[Explanation, ...] = ()
    started: float | None = None
    ended: float | None = None
    task: int = -1


def final_end(record: StepRecord, records: Iterable[StepRecord], replans_after_limit: bool = False) -> End | None:
    """Returns the end of a goal after a final failure of a step, which says how a person continues; None if it
    continues by itself.

    :param records: of all steps.
    """
    kind = FailureKind.RETRYABLE if record.state is StepState.SUCCEEDED else worst_kind(record.explanations)
    if not kind.is_final or (kind is FailureKind.LIMIT and replans_after_limit):
        return None
    reason = with_labels(record.message, records).rstrip(".")
    text = f"{reason}. No other plan is made, because {kind.words}: check the robot, then send the goal again."
    return End(Verdict.FAILED, text)


def given_up_text(reason: str, replans: int) -> str:
    """Returns the message of a goal that is given up after a number of plans."""
    dot, plans = "" if reason[-1:] == "." else ".", "plan" if replans == 1 else "plans"
    return f"{reason}{dot} The goal is given up after {replans} other {plans}." if replans else reason


def with_labels(text: str, records: Iterable[StepRecord]) -> str:
    """Returns a text with the labels of the elements of steps instead of their ids."""
    elements = (element for record in records for _, element in record.step.call.arguments)
    labels = {element.id: element.label for element in elements if element.label}
    return with_names(text, lambda eid: "", lambda eid: label_text(labels.get(eid, eid)))


@dataclass(frozen=True)
class RestoredState:
    """The state of an execution that an earlier process has begun.

    :param failures: how often each skill has failed, by (manager, skill label).
    """

    records: tuple[StepRecord, ...]
    replans: int
    plan_start: int
    failures: Counter[tuple[str, str]]
