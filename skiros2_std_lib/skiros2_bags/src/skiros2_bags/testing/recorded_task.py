"""Tasks of a recording: requests, progress and changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.testing.recording import ActionMessage, Events, NodeProgress, TaskProgress, WorldChange

#: A property of registered skills.
_MODULE = "skiros:PythonModule"

#: Longest time between the start of a task and its first progress message (s).
_MAX_START_DELAY = 0.5


@dataclass
class RecordedTask:
    """A task from start to end.

    :param progress: oldest first, without repetitions.
    :param goal: the request; None for a request by service, which bags do not contain.
    :param begin: order of the first message that the task may have caused.
    """

    manager: str
    task: int
    progress: list[TaskProgress] = field(default_factory=list)
    goal: ActionMessage | None = None
    begin: int = 0

    @property
    def end(self) -> int:
        """The order of the last message."""
        return self.progress[-1].order

    @property
    def ended(self) -> bool:
        """Whether its end is in the bag."""
        return abs(self.progress[-1].nodes[0].code) == 1

    @property
    def skills(self) -> Sequence[Any]:
        """The requested skills as `ResourceDescription`s; empty without a recorded goal."""
        return self.goal.content.skills if self.goal is not None else ()

    def __str__(self) -> str:
        labels = ", ".join(n.name for n in self.progress[0].nodes if len(n.index_path) == 1)
        return f"task {self.task} of {self.manager} ({labels})"


def recorded_tasks(recording: Events) -> list[RecordedTask]:
    """Returns the tasks of all managers, ordered by their first progress message."""
    runs: list[RecordedTask] = []
    open_runs: dict[tuple[str, int], RecordedTask] = {}
    for message in recording.progress:
        key = message.manager, message.task
        run = open_runs.get(key)
        if run is None:
            run = open_runs[key] = RecordedTask(*key)
            runs.append(run)
        last = run.progress[-1] if run.progress else None
        if last is None or last.nodes != message.nodes or _seconds(last) != _seconds(message):
            run.progress.append(message)
        if abs(message.nodes[0].code) == 1 and message.nodes[0].state in "SF":
            del open_runs[key]
    goals = _goals_of(recording, runs)
    for run in runs:
        first = run.progress[0]
        run.goal = goals.get(id(run))
        earliest = first.time - _MAX_START_DELAY
        before = run.goal.order if run.goal is not None else _first_order_after(recording, earliest)
        ended = max((r.end + 1 for r in runs if r.manager == run.manager and r.end < first.order), default=0)
        run.begin = max(before, ended)
    return runs


def task_changes(events: Events, runs: Sequence[RecordedTask]) -> list[WorldChange]:
    """Returns the changes that the managers of tasks have made since the first task, without registrations of skills.

    Includes changes after the last progress message, as the world model may publish later than the manager.
    """
    begin = {run.manager: min(r.begin for r in runs if r.manager == run.manager) for run in runs}
    return [
        event
        for event in events.changes
        if event.order >= begin.get(event.change.author, math.inf)
        and not any(_MODULE in element._props for element in event.change.elements)
        and (event.change.elements or event.change.relations)
    ]


def _goals_of(recording: Events, runs: Sequence[RecordedTask]) -> dict[int, ActionMessage]:
    """Returns the goal of each task, by `id(task)`. Feedback and result name the task."""
    found: dict[int, ActionMessage] = {}
    for event in recording.action_messages:
        if event.part not in ("feedback", "result") or not event.action.endswith("/execute"):
            continue
        manager = event.action.removesuffix("/execute")
        same = [r for r in runs if (r.manager, r.task) == (manager, getattr(event.content, "task_id", -1))]
        goals = [g for g in recording.goals(event.action) if g.goal_id == event.goal_id]
        for run in same:
            if goals and goals[0].time <= run.progress[0].time + _MAX_START_DELAY:
                found.setdefault(id(run), goals[0])
    return found


def _first_order_after(recording: Events, time: float) -> int:
    return next((e.order for e in recording.events if e.time >= time), 0)


def _seconds(message: TaskProgress) -> list[float]:
    return [node.seconds for node in message.nodes]


#: Shortest time between the end of a tick and its progress message (s).
_MIN_DELAY = 1e-4


def tick_times(progress: Sequence[TaskProgress]) -> list[float]:
    """Returns the time of the tick before each progress message (s, recording time), in ascending order.

    Message times lag some milliseconds. Each node reports the exact time from its start to its last report, so the
    times between ticks are known; only the first is taken from the bag.
    """
    times: list[float] = []
    begun: dict[tuple[int, ...], float] = {}  # start of the current run of a node
    before: dict[tuple[int, ...], NodeProgress] = {}
    for message in progress:
        now = {node.index_path: node for node in message.nodes}
        fresh = [n for path, n in now.items() if path not in before or before[path].seconds != n.seconds]
        known = [
            begun[n.index_path] + n.seconds
            for n in fresh
            if n.index_path in begun and n.seconds >= before[n.index_path].seconds > 0.0
        ]
        latest = message.time - _MIN_DELAY
        time = min(max(known), latest + 0.05) if known else latest
        times.append(max(time, times[-1]) if times else time)
        for node in fresh:
            path = node.index_path
            if path not in begun or node.seconds < before[path].seconds or before[path].state == ".":
                begun[path] = times[-1] - node.seconds
        before = now
    return times
