"""The events of a bag for a replay, in order: task progress, world model changes, action messages and clock."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import genpy
import roslib.message

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import MONITOR, PROGRESS, Message
from skiros2_bags.core.run import Run, add_progress
from skiros2_bags.core.selection import PARAMETERS
from skiros2_bags.core.world_history import read_change
from skiros2_common.core.errors import WrongValue
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.runs import Runs
from skiros2_runs.core.task_run import TaskRun
from skiros2_world_model.core.changes import Change

#: The most memory for ticks of tasks (bytes).
_MAX_KEPT = 1_000_000_000

#: Topic suffixes of an action, and suffixes of their types.
_PARTS = {"goal": "Goal", "feedback": "Feedback", "result": "Result"}

@dataclass(frozen=True)
class Event:
    """One message of a bag.

    :param order: number of the message in the bag.
    :param time: recording time (s since the epoch).
    """

    order: int
    time: float


@dataclass(frozen=True)
class TaskProgress(Event):
    """A tick of a task.

    :param frame: the tree after it.
    """

    run: TaskRun
    frame: Frame


@dataclass(frozen=True)
class WorldChange(Event):
    """A change of the world model."""

    change: Change


@dataclass(frozen=True)
class ActionMessage(Event):
    """A message of an action.

    :param part: `goal`, `feedback`, `result` or `cancel`.
    :param goal_id: "" in a cancel request for all goals.
    :param content: goal, feedback or result; None in a cancel request.
    :param caller: the sending node.
    :param status, text: of the goal, in a result.
    """

    action: str
    part: str
    goal_id: str
    content: Any
    caller: str = ""
    status: int = 0
    text: str = ""


@dataclass(frozen=True)
class ClockTick(Event):
    """The simulated time (s)."""

    now: float


@dataclass(frozen=True)
class Parameters(Event):
    """The parameters of the master."""

    values: dict[str, Any]


class Events:
    """The events of a run, in order."""

    def __init__(self, events: Iterable[Event]) -> None:
        self.events = list(events)

    @property
    def progress(self) -> list[TaskProgress]:
        return [e for e in self.events if isinstance(e, TaskProgress)]

    @property
    def changes(self) -> list[WorldChange]:
        return [e for e in self.events if isinstance(e, WorldChange)]

    @property
    def action_messages(self) -> list[ActionMessage]:
        return [e for e in self.events if isinstance(e, ActionMessage)]

    @functools.cached_property
    def managers(self) -> list[str]:
        """The names of the skill managers with recorded tasks."""
        return sorted({e.run.robot for e in self.progress})

    @functools.cached_property
    def parameters(self) -> dict[str, Any]:
        """The last recorded parameters by name; empty without recorded parameters."""
        found = [e.values for e in self.events if isinstance(e, Parameters)]
        return found[-1] if found else {}

    def goals(self, action: str) -> list[ActionMessage]:
        """Returns the goals sent to an action, oldest first."""
        return [e for e in self.action_messages if e.action == action and e.part == "goal"]

    def result(self, goal: ActionMessage) -> ActionMessage | None:
        """Returns the result of a goal; None if it was not recorded."""
        results = (e for e in self.action_messages if (e.action, e.part) == (goal.action, "result"))
        return next((e for e in results if e.goal_id == goal.goal_id), None)


class Recording(Events):
    """The events of a bag, read completely. Needs the packages of the recorded actions, but no master.

    :raises BagError: the file is not a bag, is truncated, or its messages differ from those of this system.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.run = Run.open(path)
        if self.run.damage:
            raise BagError(f"{self.run.damage}; a replay needs a complete bag")
        runs = Runs(most_bytes=_MAX_KEPT)
        messages = enumerate(self.run.messages())
        super().__init__(event for order, message in messages for event in _events(order, message, runs))


def _events(order: int, message: Message, runs: Runs) -> Iterator[Event]:
    topic, kind, time = message.topic, message.type, message.time
    if kind == PROGRESS and topic.endswith("/monitor"):
        recorded = add_progress(runs, message)
        if recorded is not None and recorded.is_new_tick:
            yield TaskProgress(order, time, recorded.run, recorded.run.latest)
    elif kind == MONITOR and topic.endswith("wm/monitor"):
        yield WorldChange(order, time, read_change(message))
    elif kind == "rosgraph_msgs/Clock":
        clock = message.content.clock
        yield ClockTick(order, time, clock.sec + clock.nanosec / 1e9)
    elif topic == PARAMETERS:
        yield Parameters(order, time, _parameters(message))
    elif kind == "actionlib_msgs/GoalID" and topic.endswith("/cancel"):
        action = topic.removesuffix("/cancel")
        yield ActionMessage(order, time, action, "cancel", message.content.id, None, message.caller)
    else:
        action, _, part = topic.rpartition("/")
        if part in _PARTS and kind.endswith(f"Action{_PARTS[part]}"):
            yield _action_message(Event(order, time), action, part, _ros_message(message), message.caller)


def _parameters(message: Message) -> dict[str, Any]:
    try:
        return _flat(json.loads(message.content.data))
    except (ValueError, RecursionError) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: expected parameters as JSON: {error}") from error


def _ros_message(message: Message) -> Any:
    """Returns the message as an object of its ROS class.

    :raises BagError: this system has no such class.
    """
    try:
        return _message_class(message.type, message.md5)().deserialize(message.data)
    except (WrongValue, genpy.DeserializationError) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: {error}") from error


@functools.cache
def _message_class(name: str, digest: str) -> Any:
    """Returns the class of a message.

    :raises WrongValue: it does not exist, or has another md5 sum.
    """
    found = roslib.message.get_message_class(name)
    if found is None:
        raise WrongValue(f"there is no message {name} on this system; expected its package to be built")
    if found._md5sum != digest:
        raise WrongValue(f"{name} was recorded with the md5 sum {digest}, here it has {found._md5sum}")
    return found


def _action_message(at: Event, action: str, part: str, message: Any, caller: str) -> ActionMessage:
    if part == "goal":
        return ActionMessage(at.order, at.time, action, part, message.goal_id.id, message.goal, caller)
    status, content = message.status, getattr(message, part)
    goal_id = status.goal_id.id
    return ActionMessage(at.order, at.time, action, part, goal_id, content, caller, status.status, status.text)


def _flat(values: Any, prefix: str = "") -> dict[str, Any]:
    """Returns nested parameters by full name."""
    if not isinstance(values, dict):
        return {prefix or "/": values}
    found: dict[str, Any] = {}
    for key, value in values.items():
        found.update(_flat(value, f"{prefix}/{key}" if not key.startswith("/") else prefix + key))
    return found
