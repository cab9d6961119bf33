"""The action `~achieve`: goals that are planned and carried out by the robots."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.ros.goal_server import ACTIVE, GoalServer
from skiros2_msgs.msg import AchieveAction as AchieveActionSpec
from skiros2_msgs.msg import AchieveFeedback, AchieveResult
from skiros2_task.core.commands import End, JobState, Phase, Record
from skiros2_task.core.conductor import Achievement, Conductor, Goal
from skiros2_task.core.planner import Limits, Planner
from skiros2_task.core.task_planner import Verdict

log = logging.getLogger(__name__)

#: How often it is planned anew at most, where a goal does not say.
MAX_REPLANS = 5

_STATES = {
    Verdict.PLANNED: AchieveResult.SUCCEEDED,
    Verdict.NOTHING_TO_DO: AchieveResult.NOTHING_TO_DO,
    Verdict.IMPOSSIBLE: AchieveResult.IMPOSSIBLE,
    Verdict.TIMED_OUT: AchieveResult.TIMED_OUT,
    Verdict.CANCELLED: AchieveResult.CANCELLED,
    Verdict.FAILED: AchieveResult.FAILED,
}


class AchieveAction(GoalServer):
    """Carries out goals, any number side by side, and cancels each by itself.

    A client that disappears leaves its goal to be carried out. `close` is for when the conductor has ended what ran.

    :param conductor: carries the goals out.
    :param planners: gives the planner for a wish; raises WrongValue.
    :param max_replans: how often it is planned anew at most, where a goal does not say.
    """

    def __init__(
        self, conductor: Conductor, planners: Callable[[str], Planner], max_replans: int = MAX_REPLANS
    ) -> None:
        super().__init__("~achieve", AchieveActionSpec)
        self._conductor = conductor
        self._planners = planners
        self._max_replans = max_replans
        self._running: list[tuple[Any, Achievement]] = []  # belongs to the action's thread

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        return _refusal(AchieveResult.CANCELLED if cancelled else AchieveResult.FAILED, message)

    def _unfinished_handles(self) -> list[Any]:
        return [handle for handle, _ in self._running]

    # -- in the thread of the action ---------------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        message = handle.get_goal()
        try:
            goal = self._goal(message)
        except WrongValue as error:
            log.warning("goal of %s is refused: %s", message.author or "somebody", error)
            handle.set_rejected(_refusal(AchieveResult.FAILED, str(error)), str(error))
            return
        handle.set_accepted()
        log.info("goal of %s: %s", message.author or "somebody", message.goals)
        teller = _Teller(handle)
        achievement = self._conductor.achieve(goal, teller.on_change, teller.on_end)
        self._running = [(h, a) for h, a in self._running if h.get_goal_status().status in ACTIVE]
        self._running.append((handle, achievement))

    def _cancel(self, handle: Any) -> None:
        for known, achievement in self._running:
            if known == handle:
                self._conductor.cancel(achievement)

    def _goal(self, message: Any) -> Goal:
        """
        :raises WrongValue: it says something that cannot be meant.
        """
        if not 0.0 <= message.seconds < float("inf"):
            raise WrongValue(f"seconds is {message.seconds}, expected a time for planning, or 0")
        return Goal(
            text=message.goals,
            priority=message.priority,
            limits=Limits(message.seconds) if message.seconds else None,
            planner=self._planners(message.wish) if message.wish else None,
            max_replans=message.max_replans if message.max_replans >= 0 else self._max_replans,
        )


class _Teller:
    """Tells the client of one goal how it goes on, from the conductor's thread."""

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def on_change(self, achievement: Achievement) -> None:
        executive = achievement.executive
        plan = [r for r in executive.records.values() if r.job.number >= executive.plan_begins or r.ended is None]
        self._handle.publish_feedback(
            AchieveFeedback(
                phase=_phase(executive.phase),
                message=executive.message,
                plan=json.dumps([_planned(record) for record in plan]),
                steps=json.dumps([_progress(record) for record in plan]),
                robots=json.dumps(_robots(plan)),
            )
        )

    def on_end(self, achievement: Achievement, end: End) -> None:
        done = achievement.done
        result = AchieveResult(
            state=_STATES[end.verdict],
            message=end.message,
            done=json.dumps([{**_planned(record), **_progress(record)} for record in done]),
            explanations=json.dumps([why.to_dict() for record in done for why in record.explanations]),
        )
        if end.verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO):
            self._handle.set_succeeded(result, end.message)
        elif end.verdict is Verdict.CANCELLED:
            self._handle.set_canceled(result, end.message)
        else:
            self._handle.set_aborted(result, end.message)


def _refusal(state: str, message: str) -> Any:
    return AchieveResult(state=state, message=message, done="[]", explanations="[]")


def _phase(phase: Phase) -> str:
    if phase is Phase.STOPPING:
        return str(AchieveFeedback.STOPPING)
    return str(AchieveFeedback.PLANNING if phase in (Phase.PLANNING, Phase.BLOCKED) else AchieveFeedback.RUNNING)


def _planned(record: Record) -> dict[str, Any]:
    """A step as it is planned."""
    job = record.job
    return {
        "number": job.number,
        "skill": job.call.type,
        "label": job.call.label,
        "robot": job.call.manager,
        "arguments": {key: element.id or element.label or element.type for key, element in job.call.arguments},
        "start": job.start,
        "end": job.end,
        "after": sorted(job.after),
    }


def _progress(record: Record) -> dict[str, Any]:
    """What has become of a step."""
    return {
        "number": record.job.number,
        "robot": record.job.call.manager,
        "state": record.state.value,
        "message": record.message,
    }


def _robots(records: Iterable[Record]) -> dict[str, int | None]:
    """What each robot does."""
    doing: dict[str, int | None] = {}
    for record in records:
        robot = record.job.call.manager
        doing.setdefault(robot, None)
        if record.state is JobState.RUNNING:
            doing[robot] = record.job.number
    return doing
