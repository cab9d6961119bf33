"""What a bag holds for a replay: progress, changes of the world, actions and clock, in the order in which they came."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import genpy
import roslib.message

from skiros2_bags.core.contract_types import MONITOR, PROGRESS
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import Message
from skiros2_bags.core.normal import GROUP_TYPE, ROOT_TYPE
from skiros2_bags.core.run import Run
from skiros2_bags.core.selection import PARAMETERS
from skiros2_bags.core.world_changes import read_change
from skiros2_common.core.errors import WrongValue
from skiros2_msgs.msg import SkillProgress
from skiros2_world_model.core.changes import Change

#: The parts of an action, as its topics end.
_PARTS = {"goal": "Goal", "feedback": "Feedback", "result": "Result"}

STATES = {
    SkillProgress.SUCCESS: "S",
    SkillProgress.FAILURE: "F",
    SkillProgress.RUNNING: "R",
    SkillProgress.IDLE: ".",
}


@dataclass(frozen=True)
class Seen:
    """A node as it was told.

    :param place: which child of which child of the root it is; () is the root.
    :param state: `R`unning, `S`uccess, `F`ailure, `.` idle.
    :param seconds: from its start to its last report of progress.
    """

    place: tuple[int, ...]
    type: str
    label: str
    processor: str
    state: str
    code: int
    message: str
    seconds: float = field(compare=False)
    params: tuple[str, ...] = field(compare=False, default=())

    @property
    def name(self) -> str:
        if self.type == ROOT_TYPE:
            return "root"
        return self.label if self.label and self.type != GROUP_TYPE else self.type.rpartition(":")[2] or self.processor


@dataclass(frozen=True)
class Event:
    """Something in a bag.

    :param order: which of the bag's messages it is.
    :param time: when it was recorded (s).
    """

    order: int
    time: float


@dataclass(frozen=True)
class Told(Event):
    """The tree of a task, each node before its children."""

    manager: str
    task: int
    nodes: tuple[Seen, ...]


@dataclass(frozen=True)
class Changed(Event):
    """A change of the world model."""

    change: Change


@dataclass(frozen=True)
class Acted(Event):
    """A message of an action.

    :param part: `goal`, `feedback`, `result` or `cancel`.
    :param goal_id: "" in a cancellation is all goals.
    :param content: the goal, feedback or result itself; None in a cancellation.
    :param caller: the node that has sent it.
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
class Ticked(Event):
    """The simulated time (s)."""

    now: float


@dataclass(frozen=True)
class Parameters(Event):
    """The parameters of the master."""

    values: dict[str, Any]


class Events:
    """What happened in a run, in order."""

    def __init__(self, events: Iterable[Event]) -> None:
        self.events = list(events)

    @property
    def told(self) -> list[Told]:
        return [e for e in self.events if isinstance(e, Told)]

    @property
    def changes(self) -> list[Changed]:
        return [e for e in self.events if isinstance(e, Changed)]

    @property
    def acted(self) -> list[Acted]:
        return [e for e in self.events if isinstance(e, Acted)]

    @functools.cached_property
    def managers(self) -> list[str]:
        """The names of the skill managers that have told of tasks."""
        return sorted({e.manager for e in self.told})

    @functools.cached_property
    def parameters(self) -> dict[str, Any]:
        """The last parameters that were recorded, by name; none where the bag has none."""
        found = [e.values for e in self.events if isinstance(e, Parameters)]
        return found[-1] if found else {}

    def goals(self, action: str) -> list[Acted]:
        """The goals that were sent to an action, oldest first."""
        return [e for e in self.acted if e.action == action and e.part == "goal"]

    def result(self, goal: Acted) -> Acted | None:
        """What became of a goal; None when that is not in the bag."""
        same = (e for e in self.acted if e.action == goal.action and e.part == "result" and e.goal_id == goal.goal_id)
        return next(same, None)


class Recording(Events):
    """A bag, read whole; needs no master, but the packages whose actions it holds.

    :raises BagError: it is no bag, was cut off, or its messages are other ones than those of this system.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.run = Run.open(path)
        if self.run.damage:
            raise BagError(f"{self.run.damage}; a replay needs the whole")
        messages = enumerate(self.run.messages())
        super().__init__(event for order, message in messages for event in _events(order, message))


def _events(order: int, message: Message) -> Iterator[Event]:
    topic, kind, time = message.topic, message.type, message.time
    if kind == PROGRESS and topic.endswith("/monitor"):
        nodes = message.content.progress
        if nodes:
            yield Told(order, time, topic.removesuffix("/monitor"), nodes[0].task_id, tree(nodes))
    elif kind == MONITOR and topic.endswith("wm/monitor"):
        yield Changed(order, time, read_change(message))
    elif kind == "rosgraph_msgs/Clock":
        clock = message.content.clock
        yield Ticked(order, time, clock.sec + clock.nanosec / 1e9)
    elif topic == PARAMETERS:
        yield Parameters(order, time, _parameters(message))
    elif kind == "actionlib_msgs/GoalID" and topic.endswith("/cancel"):
        action = topic.removesuffix("/cancel")
        yield Acted(order, time, action, "cancel", message.content.id, None, message.caller)
    else:
        action, _, part = topic.rpartition("/")
        if part in _PARTS and kind.endswith(f"Action{_PARTS[part]}"):
            yield _acted(Event(order, time), action, part, _ros_message(message), message.caller)


def _parameters(message: Message) -> dict[str, Any]:
    try:
        return _flat(json.loads(message.content.data))
    except (ValueError, RecursionError) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: expected parameters as JSON: {error}") from error


def _ros_message(message: Message) -> Any:
    """The message as skills get it.

    :raises BagError: this system has no such message.
    """
    try:
        return _message_class(message.type, message.md5)().deserialize(message.data)
    except (WrongValue, genpy.DeserializationError) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: {error}") from error


@functools.cache
def _message_class(name: str, digest: str) -> Any:
    """The class of a message.

    :raises WrongValue: there is none, or it is another one than the one with that md5 sum.
    """
    found = roslib.message.get_message_class(name)
    if found is None:
        raise WrongValue(f"there is no message {name} on this system; expected its package to be built")
    if found._md5sum != digest:
        raise WrongValue(f"{name} was recorded with the md5 sum {digest}, here it has {found._md5sum}")
    return found


def _acted(at: Event, action: str, part: str, message: Any, caller: str) -> Acted:
    if part == "goal":
        return Acted(at.order, at.time, action, part, message.goal_id.id, message.goal, caller)
    status, content = message.status, getattr(message, part)
    return Acted(at.order, at.time, action, part, status.goal_id.id, content, caller, status.status, status.text)


def tree(nodes: list[Any]) -> tuple[Seen, ...]:
    """The nodes of a message with their places, each before its children."""
    places: dict[int, tuple[int, ...]] = {}
    children: dict[int, int] = {}
    seen = []
    for node in nodes:
        if node.parent_id in places:
            index = children.get(node.parent_id, 0)
            children[node.parent_id] = index + 1
            place = (*places[node.parent_id], index)
        else:
            place = ()
        places[node.id] = place
        params = tuple(p.param for p in node.params)
        state = STATES.get(node.state, "?")
        seen.append(
            Seen(
                place, node.type, node.label, node.processor, state, node.progress_code, node.progress_message,
                node.progress_time, params,
            )
        )  # fmt: skip
    return tuple(seen)


def _flat(values: Any, prefix: str = "") -> dict[str, Any]:
    """Parameters by full name."""
    if not isinstance(values, dict):
        return {prefix or "/": values}
    found: dict[str, Any] = {}
    for key, value in values.items():
        found.update(_flat(value, f"{prefix}/{key}" if not key.startswith("/") else prefix + key))
    return found
