"""What the system was asked to reach."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_bags.core.action_call import ActionCall

#: The result codes of `AssignTask`.
_PLANS = {1: "failed", 2: "nothing_to_do", 3: "plan_found"}

_ASSIGN, _ACHIEVE = "skiros2_msgs/AssignTask", "skiros2_msgs/Achieve"


@dataclass(frozen=True)
class Goal:
    """A goal for the task manager, which it plans for (`AssignTask`) or carries out too (`Achieve`).

    :param time: when it was recorded (s since the epoch).
    :param goals: its text.
    :param end: when the result was recorded; None when it was not.
    :param state: of `Achieve`: as in its result; of `AssignTask`: plan_found, nothing_to_do or failed; "" without one.
    :param message: in words; the plan, as JSON, of a goal that was planned for.
    """

    time: float
    goals: str
    author: str
    end: float | None
    state: str
    message: str
    call: ActionCall


def goals_among(calls: Iterable[ActionCall]) -> list[Goal]:
    """The goals for task managers among the calls of actions."""
    return [_goal(call) for call in calls if call.type in (_ASSIGN, _ACHIEVE) and call.goal is not None]


def _goal(call: ActionCall) -> Goal:
    assert call.goal is not None
    asked = call.goal.content.goal
    state = message = ""
    if call.result is not None:
        answer = call.result.content.result
        if call.type == _ACHIEVE:
            state, message = answer.state, answer.message
        else:
            state = _PLANS.get(answer.progress_code, f"code {answer.progress_code}")
            message = answer.progress_message
    return Goal(call.goal.time, asked.goals, asked.author, call.end, state, message, call)
