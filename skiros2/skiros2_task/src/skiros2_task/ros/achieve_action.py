"""The action `~achieve`: plans goals and executes the plans."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.explanation import PARAMETER, UNSET, Explanation, Provenance
from skiros2_common.core.names import full_name
from skiros2_common.ros.goal_server import ACTIVE, GoalServer, is_cancelled
from skiros2_msgs.msg import AchieveAction as AchieveActionSpec
from skiros2_msgs.msg import AchieveFeedback, AchieveResult
from skiros2_skill.core.runtime.request import REFUSED_CODE
from skiros2_task.core.commands import End
from skiros2_task.core.execution import Phase, StepRecord, StepState
from skiros2_task.core.executor import Goal, GoalExecution, GoalExecutor
from skiros2_task.core.given_plan import GivenPlan
from skiros2_task.core.planning import Verdict
from skiros2_task.ros.plan_actions import START_DELAY, PlanningOptions, end_goal

log = logging.getLogger(__name__)

#: The default of a goal's `max_replans`.
MAX_REPLANS = 5
#: The default of `interrupt_priority`.
INTERRUPT_PRIORITY = 100
#: How long a client that was restarted can read how its goal has ended (s).
_STATUS_KEPT = 60.0


class AchieveAction(GoalServer):
    """Executes any number of goals at once. A goal continues when its client disappears.

    To be closed after the executor.

    :param max_replans: for goals with negative `max_replans`.
    :param interrupt_priority: goals with this priority, or a higher one, interrupt goals with a lower priority.
    """

    def __init__(
        self, executor: GoalExecutor, options: PlanningOptions, max_replans: int = MAX_REPLANS,
        interrupt_priority: int = INTERRUPT_PRIORITY,
    ) -> None:  # fmt: skip
        super().__init__("~achieve", AchieveActionSpec, _STATUS_KEPT, START_DELAY)
        self._executor = executor
        self._options = options
        self._max_replans = max_replans
        self._interrupt_priority = interrupt_priority
        #: Replaced by the thread of the goals, never changed.
        self._running: tuple[tuple[Any, GoalExecution], ...] = ()

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        return _refusal(AchieveResult.CANCELLED if cancelled else AchieveResult.FAILED, message)

    def _unfinished_handles(self) -> list[Any]:
        return [handle for handle, _ in self._running]

    # -- in the threads of the action --------------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        message = handle.get_goal()
        try:
            goal = self._goal(message)
        except WrongValue as error:
            log.warning("goal of %s is rejected: %s", message.author or "unknown", error)
            handle.set_rejected(_refusal(AchieveResult.FAILED, str(error)), str(error))
            return
        handle.set_accepted()
        log.info("goal of %s: %s", message.author or "unknown", message.goals)
        publisher = _GoalPublisher(handle)
        execution = self._executor.achieve(goal, publisher.on_change, publisher.on_end)
        active = [(h, a) for h, a in self._running if h.get_goal_status().status in ACTIVE]
        self._running = (*active, (handle, execution))
        if is_cancelled(handle):
            self._executor.cancel(execution)

    def _cancel(self, handle: Any) -> None:
        for known, execution in self._running:
            if known == handle:
                self._executor.cancel(execution)

    def _goal(self, message: Any) -> Goal:
        """
        :raises WrongValue: a field has an invalid value.
        """
        planner = self._options.planner(message.wish)
        max_replans = message.max_replans if message.max_replans >= 0 else self._max_replans
        return Goal(
            text=message.goals,
            priority=message.priority,
            limits=self._options.limits(message.seconds),
            planner=planner,
            max_replans=0 if isinstance(planner, GivenPlan) else max_replans,
            interrupts=message.priority >= self._interrupt_priority,
        )


class _GoalPublisher:
    """Publishes feedback and result of one goal, from the executor's thread."""

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def on_change(self, execution: GoalExecution) -> None:
        machine = execution.machine
        records = machine.records.values()
        plan = [r for r in records if r.step.number >= machine.plan_start or r.ended is None]
        self._handle.publish_feedback(
            AchieveFeedback(
                phase=_phase(machine.phase),
                message=machine.message,
                plan=json.dumps([record.step.to_dict() for record in plan]),
                steps=json.dumps([_progress(record) for record in plan]),
                robots=json.dumps(_robots(plan)),
            )
        )

    def on_end(self, execution: GoalExecution, end: End) -> None:
        started = execution.started
        result = AchieveResult(
            state=AchieveResult.SUCCEEDED if end.verdict is Verdict.PLANNED else end.verdict.state,
            message=end.message,
            done=json.dumps([{**record.step.to_dict(), **_progress(record)} for record in started]),
            explanations=json.dumps(
                [why.to_dict() for record in started for why in record.explanations]
                + [why.to_dict() for why in _missing_values(end.missing)]
            ),
        )
        end_goal(self._handle, end.verdict, result, end.message)


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


def _refusal(state: str, message: str) -> Any:
    return AchieveResult(state=state, message=message, done="[]", explanations="[]")


def _phase(phase: Phase) -> str:
    if phase is Phase.STOPPING:
        return str(AchieveFeedback.STOPPING)
    return str(AchieveFeedback.PLANNING if phase in (Phase.PLANNING, Phase.BLOCKED) else AchieveFeedback.RUNNING)


def _progress(record: StepRecord) -> dict[str, Any]:
    """Returns the state of a step as JSON data."""
    return {
        "number": record.step.number,
        "robot": record.step.call.manager,
        "state": record.state.value,
        "message": record.message,
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
