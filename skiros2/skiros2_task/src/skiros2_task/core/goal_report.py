"""The progress and the result of a goal, as the messages of the action `achieve` and commands have them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.explanation import PARAMETER, UNSET, Explanation, Provenance, worst_kind
from skiros2_common.core.names import full_name
from skiros2_skill.core.runtime.request import REFUSED_CODE
from skiros2_task.core.commands import End
from skiros2_task.core.goal_execution import GoalExecution
from skiros2_task.core.planning import Verdict
from skiros2_task.core.step_record import Phase, StepRecord, StepState

PLANNING, RUNNING, STOPPING = "planning", "running", "stopping"
#: The phase of a goal that asks how to continue after a restart. No constant of the message, whose md5 sum covers them.
ASKING = "asking"

SUCCEEDED = "succeeded"

_PHASES = {
    Phase.STOPPING: STOPPING,
    Phase.ASKING: ASKING,
    Phase.PLANNING: PLANNING,
    Phase.BLOCKED: PLANNING,
}


@dataclass(frozen=True)
class GoalProgress:
    """The fields of an `AchieveFeedback`."""

    phase: str
    message: str
    plan: str
    steps: str
    robots: str


@dataclass(frozen=True)
class GoalResult:
    """The fields of an `AchieveResult`."""

    state: str
    message: str
    done: str
    explanations: str


def progress_of(execution: GoalExecution) -> GoalProgress:
    """Returns the progress of a goal: the steps of the current plan, and those of earlier plans that still run."""
    machine = execution.machine
    plan = [r for r in machine.records.values() if r.step.number >= machine.plan_start or r.ended is None]
    return GoalProgress(
        phase=_PHASES.get(machine.phase, RUNNING),
        message=machine.message,
        plan=json.dumps([record.step.to_dict() for record in plan]),
        steps=json.dumps([_state(record) for record in plan]),
        robots=json.dumps(_robots(plan)),
    )


def result_of(execution: GoalExecution, end: End) -> GoalResult:
    """Returns the result of a goal: the started steps, and why skills failed, the most severe kind at the end."""
    started = execution.started
    by_severity = sorted(started, key=lambda record: worst_kind(record.explanations).severity)
    return GoalResult(
        state=SUCCEEDED if end.verdict is Verdict.PLANNED else end.verdict.state,
        message=end.message,
        done=json.dumps([{**record.step.to_dict(), **_state(record)} for record in started]),
        explanations=json.dumps(
            [why.to_dict() for record in by_severity for why in record.explanations]
            + [why.to_dict() for why in _missing_values(end.missing)]
        ),
    )


def _missing_values(names: Sequence[str]) -> list[Explanation]:
    """Explains the parameters without a value, as SKILL.PARAMETER, for each skill."""
    keys: dict[str, list[str]] = {}
    for name in names:
        skill, _, key = name.partition(".")
        keys.setdefault(full_name(skill), []).append(key)
    return [
        Explanation(
            PARAMETER,
            skill,
            "",
            node=-1,
            code=REFUSED_CODE,
            message=f"no values for {', '.join(of_skill)}",
            params=[Provenance(key, "", UNSET) for key in of_skill],
        )
        for skill, of_skill in keys.items()
    ]


def _state(record: StepRecord) -> dict[str, Any]:
    """Returns the state of a step as JSON data; `task` once it is known."""
    return {
        "number": record.step.number,
        "robot": record.step.call.manager,
        "state": record.state.value,
        "message": record.message,
        **({"task": record.task} if record.task >= 0 else {}),
    }


def _robots(records: Iterable[StepRecord]) -> dict[str, int | None]:
    """Returns the number of each robot's running step."""
    running: dict[str, int | None] = {}
    for record in records:
        robot = record.step.call.manager
        running.setdefault(robot, None)
        if record.state is StepState.RUNNING:
            running[robot] = record.step.number
    return running
