"""The events of a bag for a re-run, in order: task progress, world model changes, action messages and clock; and its
tasks."""

from __future__ import annotations

import functools
import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skiros2_bags.core.bag_file import MONITOR, PROGRESS, BagError, Message
from skiros2_bags.core.bag_writer import DECLARATIONS, EVIDENCE, PARAMETERS
from skiros2_bags.core.run import Run, add_progress
from skiros2_bags.core.world_history import read_change
from skiros2_bags.testing.evidence import sorted_groups
from skiros2_bags.testing.ros_messages import ros_message
from skiros2_common.core.operations import Change
from skiros2_common.core.signals import TOPIC
from skiros2_runs.core.frame import Frame, NodeProgress
from skiros2_runs.core.runs import Runs
from skiros2_runs.core.states import IDLE
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.core.engine.evidence import Entry, Reading

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
    :param number: of its message among those of the task, from 1.
    """

    run: TaskRun
    frame: Frame
    number: int = 0


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
class ServerStatus(Event):
    """The status that an action server has published; recorded when it changes."""

    action: str


@dataclass(frozen=True)
class ClockTick(Event):
    """The simulated time (s)."""

    now: float


@dataclass(frozen=True)
class SignalMessage(Event):
    """A message of a signal of the recorded scene."""

    topic: str
    message: Any


@dataclass(frozen=True)
class Parameters(Event):
    """The parameters of the master."""

    values: dict[str, Any]


@dataclass(frozen=True)
class Declarations(Event):
    """What the skills of a manager declare, as it has published it."""

    manager: str
    text: str


@dataclass(frozen=True)
class EvidenceEntries(Event):
    """What the engine of a manager has done with a task; see `skiros2_skill.core.engine.evidence`.

    :param number: of the progress message of the same tick, from 1.
    :param readings: the times that skills have read in this tick.
    """

    manager: str
    task_id: int
    entries: tuple[Entry, ...]
    version: int
    number: int = 0
    readings: tuple[Reading, ...] = ()


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

    @functools.cached_property
    def declarations(self) -> dict[str, str]:
        """What the skills of each manager have declared last, by its name."""
        return {e.manager: e.text for e in self.events if isinstance(e, Declarations)}

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
        topics: set[str] = set()
        numbers: Counter[int] = Counter()
        super().__init__(e for order, message in messages for e in _events(order, message, runs, topics, numbers))


def _events(order: int, message: Message, runs: Runs, signals: set[str], numbers: Counter[int]) -> Iterator[Event]:
    """Yields the events of a message.

    :param signals: the topics of the signals that earlier messages have described; updated.
    :param numbers: how many progress messages of each task there were, by the identity of its run; updated.
    """
    topic, kind, time = message.topic, message.type, message.time
    if kind == PROGRESS and topic.endswith("/monitor"):
        recorded = add_progress(runs, message)
        if recorded is not None:
            numbers[id(recorded.run)] += 1
            if recorded.is_new_tick:
                yield TaskProgress(order, time, recorded.run, recorded.run.latest, numbers[id(recorded.run)])
    elif kind == MONITOR and topic.endswith("wm/monitor"):
        change = read_change(message)
        signals.update(f"/{str(e.value_of(TOPIC)).lstrip('/')}" for e in change.elements if e.hasProperty(TOPIC))
        yield WorldChange(order, time, change)
    elif topic in signals:
        yield SignalMessage(order, time, topic, ros_message(message))
    elif kind == "rosgraph_msgs/Clock":
        clock = message.content.clock
        yield ClockTick(order, time, clock.sec + clock.nanosec / 1e9)
    elif topic == PARAMETERS:
        yield Parameters(order, time, _parameters(message))
    elif kind == "std_msgs/String" and topic.endswith(f"/{DECLARATIONS}"):
        yield Declarations(order, time, topic.removesuffix(f"/{DECLARATIONS}"), message.content.data)
    elif kind == "std_msgs/String" and topic.endswith(f"/{EVIDENCE}"):
        yield _evidence(Event(order, time), message)
    elif kind == "actionlib_msgs/GoalStatusArray" and topic.endswith("/status"):
        yield ServerStatus(order, time, topic.removesuffix("/status"))
    elif kind == "actionlib_msgs/GoalID" and topic.endswith("/cancel"):
        action = topic.removesuffix("/cancel")
        yield ActionMessage(order, time, action, "cancel", message.content.id, None, message.caller)
    else:
        action, _, part = topic.rpartition("/")
        if part in _PARTS and kind.endswith(f"Action{_PARTS[part]}"):
            yield _action_message(Event(order, time), action, part, ros_message(message), message.caller)


def _evidence(at: Event, message: Message) -> EvidenceEntries:
    try:
        found = json.loads(message.content.data)
        read = [(str(path), str(kind), str(name), value) for path, kind, name, value in found["entries"]]
        entries = tuple(sorted_groups(read, "write"))
        manager, version = message.topic.removesuffix(f"/{EVIDENCE}"), int(found.get("version", 1))
        readings = tuple((str(path), float(read)) for path, read in found.get("readings", ()))
        return EvidenceEntries(
            at.order, at.time, manager, found["task"], entries, version, int(found.get("number", 0)), readings
        )
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: expected evidence as JSON: {error!r}") from error


def _parameters(message: Message) -> dict[str, Any]:
    try:
        return _flat(json.loads(message.content.data))
    except (ValueError, RecursionError) as error:
        raise BagError(f"{message.topic} at {message.time:.3f} s: expected parameters as JSON: {error}") from error


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


#: A property of registered skills.
_MODULE = "skiros:PythonModule"

#: Longest time between the start of a task and its first progress message (s).
_MAX_START_DELAY = 0.5


@dataclass
class RecordedTask:
    """A task from start to end.

    :param progress: the messages with its ticks, oldest first.
    :param goal: the request; None for a request by service, which bags do not contain.
    :param begin: order of the first message that the task may have caused.
    :param evidence: what the engine has done with it; None if that was not recorded.
    :param has_writes: whether this has what hooks wrote.
    :param readings: the times that skills have read, by the number of the tick's progress message.
    """

    run: TaskRun
    progress: list[TaskProgress] = field(default_factory=list)
    goal: ActionMessage | None = None
    begin: int = 0
    evidence: list[Entry] | None = None
    has_writes: bool = False
    readings: dict[int, tuple[Reading, ...]] = field(default_factory=dict)

    @property
    def manager(self) -> str:
        return self.run.robot

    @property
    def end(self) -> int:
        """The order of the last message."""
        return self.progress[-1].order

    @property
    def skills(self) -> Sequence[Any]:
        """The requested skills as `ResourceDescription`s; empty without a recorded goal."""
        return self.goal.content.skills if self.goal is not None else ()

    def __str__(self) -> str:
        return f"task {self.run.task_id} of {self.manager} ({self.progress[0].frame.shape.skills_text()})"


def recorded_tasks(recording: Events) -> list[RecordedTask]:
    """Returns the tasks of all managers, ordered by their first progress message."""
    found: dict[int, RecordedTask] = {}
    for message in recording.progress:
        found.setdefault(id(message.run), RecordedTask(message.run)).progress.append(message)
    tasks = list(found.values())
    for task in tasks:
        first = task.progress[0]
        task.goal = _goal_of(recording, task)
        earliest = first.time - _MAX_START_DELAY
        # The goal may be recorded after the first progress: they come over different connections.
        requested = task.goal.order if task.goal is not None else _first_order_after(recording, earliest)
        ended = max((t.end + 1 for t in tasks if t.manager == task.manager and t.end < first.order), default=0)
        begin = min(requested, first.order)
        task.begin = max(begin, ended) if ended else min(begin, _first_change(recording, task.manager, begin, earliest))
    for event in (e for e in recording.events if isinstance(e, EvidenceEntries)):
        latest = [t for t in tasks if (t.manager, t.run.task_id) == (event.manager, event.task_id)
                  and t.progress[0].time - _MAX_START_DELAY <= event.time]  # fmt: skip
        if latest:
            latest[-1].evidence = [*(latest[-1].evidence or ()), *event.entries]
            latest[-1].has_writes = event.version >= 2
            latest[-1].readings[event.number] = event.readings
    for task in tasks:
        if max(task.readings, default=0) > task.progress[-1].number:
            task.readings = {}  # the recorder has missed progress: the ticks of the readings are not known
    return tasks


def task_changes(events: Events, tasks: Sequence[RecordedTask]) -> list[WorldChange]:
    """Returns the changes that the managers of tasks have made since the first task, without registrations of skills.

    Includes changes after the last progress message, as the world model may publish later than the manager.
    """
    begin = {task.manager: min(t.begin for t in tasks if t.manager == task.manager) for task in tasks}
    return [
        event
        for event in events.changes
        if event.order >= begin.get(event.change.author, math.inf)
        and not _is_registration(event)
        and (event.change.elements or event.change.relations)
    ]


def _is_registration(event: WorldChange) -> bool:
    return any(_MODULE in element.property_view for element in event.change.elements)


def _first_change(recording: Events, manager: str, begin: int, earliest: float) -> int:
    """Returns the order of the first change of a manager's first task, if it was recorded before its goal.

    :param begin: the order of the goal or of the first progress; returned without such a change.
    :param earliest: the earliest time of the change (s).
    """
    found = begin
    for event in (e for e in reversed(recording.changes) if e.change.author == manager and e.order < begin):
        if event.time < earliest or _is_registration(event):
            break
        found = event.order
    return found


def _goal_of(recording: Events, task: RecordedTask) -> ActionMessage | None:
    """Returns the goal of a task; None without one. Feedback and result of the goal name the task."""
    action = f"{task.manager}/execute"
    answers = (e for e in recording.action_messages if e.action == action and e.part in ("feedback", "result"))
    for event in answers:
        if getattr(event.content, "task_id", -1) != task.run.task_id:
            continue
        goal = next((g for g in recording.goals(action) if g.goal_id == event.goal_id), None)
        if goal is not None and goal.time <= task.run.start + _MAX_START_DELAY:
            return goal
    return None


def _first_order_after(recording: Events, time: float) -> int:
    return next((e.order for e in recording.events if e.time >= time), 0)


#: Shortest time between the end of a tick and its progress message (s).
_MIN_DELAY = 1e-4
#: The longest lag of a message that is made up for (s).
_MAX_LAG = 1.0


def tick_times(progress: Sequence[TaskProgress]) -> list[float]:
    """Returns the time of the tick before each progress message (s, recording time), in ascending order.

    Messages lag some milliseconds, on a busy machine much more. Each node reports the exact time from its start to its
    last report, so the times between ticks are known. Ticks are moved back together as soon as a message lags less than
    those before.
    """
    times: list[float] = []
    first, lag = 0, 0.0  # of the ticks whose distances are known: the first one, and how much its message lagged
    begun: dict[tuple[int, ...], float] = {}  # start of the current run of a node
    before: dict[tuple[int, ...], NodeProgress] = {}
    for message in progress:
        now = message.frame.nodes
        fresh = {path: n for path, n in now.items() if path not in before or before[path].run_time != n.run_time}
        known = [
            begun[path] + n.run_time
            for path, n in fresh.items()
            if path in begun and path in before and n.run_time >= before[path].run_time > 0.0
        ]
        latest = message.time - _MIN_DELAY
        if not known:
            first, lag = len(times), 0.0
        time = max(known, default=latest)
        earlier = min(time - latest, _MAX_LAG - lag)
        if earlier > 0.0:
            lag, time = lag + earlier, time - earlier
            least = times[first - 1] if first else -math.inf
            times[first:] = [max(least, tick - earlier) for tick in times[first:]]
            begun = {path: start - earlier for path, start in begun.items()}
        time = min(time, latest + 0.05)
        times.append(max(time, times[-1]) if times else time)
        for path, node in fresh.items():
            if path not in begun or path not in before or node.run_time < before[path].run_time or (
                before[path].state == IDLE
            ):  # fmt: skip
                begun[path] = times[-1] - node.run_time
        before = now
    return times
