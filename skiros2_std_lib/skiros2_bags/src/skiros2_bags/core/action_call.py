"""The goals that were sent to action servers, and what came of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.core.message import Message

#: The names of actionlib's states of goals.
STATUS = ("pending", "active", "preempted", "succeeded", "aborted", "rejected", "preempting", "recalling", "recalled",
          "lost")  # fmt: skip

_STATUS_TYPE = "actionlib_msgs/GoalStatusArray"
_PARTS = ("goal", "feedback", "result", "cancel", "status")


@dataclass
class ActionCall:
    """A goal of an action.

    :param name: of the action: `/tm/task_plan`.
    :param type: of the action: `skiros2_msgs/AssignTask`.
    :param goal: None when it was not recorded; only what followed tells of it then.
    :param feedback: oldest first.
    :param result: None when it was not recorded: the goal was still active at the end of the bag.
    :param status: the last that the server told, as in `actionlib_msgs/GoalStatus`; None: it told nothing.
    :param accepted: when the server first told of the goal (s since the epoch).
    :param cancelled: when it was asked to stop; None: never.
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
        """When the goal, or the first that was heard of it, was recorded (s since the epoch)."""
        times = [m.time for m in (self.goal, self.result, *self.feedback[:1]) if m is not None]
        times += [self.accepted] if self.accepted is not None else []
        return min(times)

    @property
    def end(self) -> float | None:
        """When the result was recorded; None when it was not."""
        return self.result.time if self.result is not None else None

    @property
    def status_name(self) -> str:
        if self.status is None:
            return "unanswered"
        return STATUS[self.status] if 0 <= self.status < len(STATUS) else f"status {self.status}"


def action_topics(topics: Mapping[str, str]) -> dict[str, str]:
    """The actions whose topics are among those given: the type of each by its name.

    :param topics: the type of each topic.
    """
    found = {}
    for topic, kind in topics.items():
        name, _, part = topic.rpartition("/")
        suffix = f"Action{part.title()}"
        if part in ("goal", "feedback", "result") and kind.endswith(suffix):
            found[name] = kind.removesuffix(suffix)
    return found


def topics_of(actions: Iterable[str]) -> list[str]:
    """The topics of some actions."""
    return [f"{name}/{part}" for name in actions for part in _PARTS]


def action_calls(messages: Iterable[Message], actions: Mapping[str, str]) -> list[ActionCall]:
    """The goals in the order in which they were first heard of.

    :param messages: of the topics of the actions, oldest first.
    :param actions: the type of each action by its name.
    :raises BagError: one cannot be read.
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
            _end(call(name, content.status.goal_id.id), message)
        elif part == "cancel":
            for known in _meant(calls.values(), name, content):
                known.cancelled = message.time if known.cancelled is None else known.cancelled
        elif message.type == _STATUS_TYPE:
            for status in content.status_list:
                _take_status(call(name, status.goal_id.id), status, message.time)
    return list(calls.values())


def _set_goal(call: ActionCall, message: Message) -> None:
    call.goal = message if call.goal is None else call.goal


def _end(call: ActionCall, message: Message) -> None:
    if call.result is None:
        call.result = message
        call.status, call.status_text = message.content.status.status, message.content.status.text
        call.accepted = message.time if call.accepted is None else call.accepted


def _take_status(call: ActionCall, status: Any, time: float) -> None:
    call.accepted = time if call.accepted is None else call.accepted
    if call.result is None:
        call.status, call.status_text = status.status, status.text


def _meant(calls: Iterable[ActionCall], name: str, cancel: Any) -> list[ActionCall]:
    """Whom a cancellation is about: the goal of its id; without one all, or those sent up to its stamp."""
    open_calls = [c for c in calls if c.name == name and c.result is None]
    if cancel.id:
        return [c for c in open_calls if c.goal_id == cancel.id]
    stamp = cancel.stamp.sec + cancel.stamp.nanosec / 1e9
    return [c for c in open_calls if not stamp or (c.goal is not None and c.goal.time <= stamp)]
