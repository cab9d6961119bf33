"""Goals sent to action servers and their results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.core.bag_file import Message

#: Names of the goal states of actionlib, by number.
STATUS = ("pending", "active", "preempted", "succeeded", "aborted", "rejected", "preempting", "recalling", "recalled",
          "lost")  # fmt: skip

_STATUS_TYPE = "actionlib_msgs/GoalStatusArray"
_PARTS = ("goal", "feedback", "result", "cancel", "status")


@dataclass
class ActionCall:
    """One goal of an action.

    :param name: of the action, for example `/tm/task_plan`.
    :param type: of the action, for example `skiros2_msgs/AssignTask`.
    :param goal: None when the goal message was not recorded.
    :param feedback: oldest first.
    :param result: None when no result was recorded: the goal was active at the end of the bag.
    :param status: the last reported status, as in `actionlib_msgs/GoalStatus`; None without any report.
    :param accepted: time of the first status or result (s since the epoch).
    :param cancelled: time of the first cancel request; None without one.
    """

    name: str
    type: str
    goal_id: str
    goal: Message | None = None
    feedback: list[Message] = field(default_factory=list)
    result: Message | None = None
    status: int | None = None
    status_text: str = ""
    accepted: float | None = None
    cancelled: float | None = None

    @property
    def start(self) -> float:
        """Time of the first recorded message of the goal (s since the epoch)."""
        times = [m.time for m in (self.goal, self.result, *self.feedback[:1]) if m is not None]
        times += [self.accepted] if self.accepted is not None else []
        return min(times)

    @property
    def end(self) -> float | None:
        """Time of the result; None without one."""
        return self.result.time if self.result is not None else None

    @property
    def status_name(self) -> str:
        if self.status is None:
            return "unanswered"
        return STATUS[self.status] if 0 <= self.status < len(STATUS) else f"status {self.status}"


def action_topics(topics: Mapping[str, str]) -> dict[str, str]:
    """Returns the type of each action, by name.

    :param topics: the type of each topic.
    """
    found = {}
    for topic, kind in topics.items():
        name, _, part = topic.rpartition("/")
        suffix = f"Action{part.title()}"
        if part in ("goal", "feedback", "result") and kind.endswith(suffix):
            found[name] = kind.removesuffix(suffix)
    return found


def action_topic_names(actions: Iterable[str]) -> list[str]:
    """Returns the topics of actions."""
    return [f"{name}/{part}" for name in actions for part in _PARTS]


def action_calls(messages: Iterable[Message], actions: Mapping[str, str]) -> list[ActionCall]:
    """Returns the goals in the order of their first message.

    :param messages: of the topics of the actions, oldest first.
    :param actions: the type of each action, by name.
    :raises BagError: a message cannot be read.
    """
    calls: dict[tuple[str, str], ActionCall] = {}

    def call(name: str, goal_id: str) -> ActionCall:
        return calls.setdefault((name, goal_id), ActionCall(name, actions[name], goal_id))

    for message in messages:
        name, _, part = message.topic.rpartition("/")
        content = message.content
        if part == "goal":
            _set_goal(call(name, content.goal_id.id), message)
        elif part == "feedback":
            call(name, content.status.goal_id.id).feedback.append(message)
        elif part == "result":
            _set_result(call(name, content.status.goal_id.id), message)
        elif part == "cancel":
            for known in _cancelled_calls(calls.values(), name, content):
                known.cancelled = message.time if known.cancelled is None else known.cancelled
        elif message.type == _STATUS_TYPE:
            for status in content.status_list:
                _set_status(call(name, status.goal_id.id), status, message.time)
    return list(calls.values())


def _set_goal(call: ActionCall, message: Message) -> None:
    call.goal = message if call.goal is None else call.goal


def _set_result(call: ActionCall, message: Message) -> None:
    if call.result is None:
        call.result = message
        call.status, call.status_text = message.content.status.status, message.content.status.text
        call.accepted = message.time if call.accepted is None else call.accepted


def _set_status(call: ActionCall, status: Any, time: float) -> None:
    call.accepted = time if call.accepted is None else call.accepted
    if call.result is None:
        call.status, call.status_text = status.status, status.text


def _cancelled_calls(calls: Iterable[ActionCall], name: str, cancel: Any) -> list[ActionCall]:
    """Returns the goals that a cancel request addresses: by id; without id all, or those sent up to its stamp."""
    open_calls = [c for c in calls if c.name == name and c.result is None]
    if cancel.id:
        return [c for c in open_calls if c.goal_id == cancel.id]
    stamp = cancel.stamp.sec + cancel.stamp.nanosec / 1e9
    return [c for c in open_calls if not stamp or (c.goal is not None and c.goal.time <= stamp)]


#: Names of the result codes of `AssignTask`.
_PLANS = {1: "failed", 2: "nothing_to_do", 3: "plan_found"}

#: The types of the actions of a task manager.
ASSIGN, ACHIEVE = "skiros2_msgs/AssignTask", "skiros2_msgs/Achieve"


@dataclass(frozen=True)
class Goal:
    """A goal for the task manager: `AssignTask` plans for it, `Achieve` also executes the plan.

    :param time: when it was recorded (s since the epoch).
    :param goals: its text.
    :param end: time of the result; None without one.
    :param state: for `Achieve`, that of its result; for `AssignTask`, plan_found, nothing_to_do or failed; "" without
        result.
    :param message: of the result; for `AssignTask` with a plan, the plan as JSON.
    """

    time: float
    goals: str
    author: str
    end: float | None
    state: str
    message: str
    call: ActionCall


def planning_goals(calls: Iterable[ActionCall]) -> list[Goal]:
    """Returns the goals for task managers."""
    return [_goal(call) for call in calls if call.type in (ASSIGN, ACHIEVE) and call.goal is not None]


def _goal(call: ActionCall) -> Goal:
    assert call.goal is not None
    request = call.goal.content.goal
    state = message = ""
    if call.result is not None:
        result = call.result.content.result
        if call.type == ACHIEVE:
            state, message = result.state, result.message
        else:
            state = _PLANS.get(result.progress_code, f"code {result.progress_code}")
            message = result.progress_message
    return Goal(call.goal.time, request.goals, request.author, call.end, state, message, call)
