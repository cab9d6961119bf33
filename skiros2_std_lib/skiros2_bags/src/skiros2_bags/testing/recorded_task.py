"""Tasks of a recording: requests, progress and changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.testing.recording import ActionMessage, Events, TaskProgress, WorldChange
from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.states import IDLE
from skiros2_runs.core.task_run import TaskRun

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
    """

    run: TaskRun
    progress: list[TaskProgress] = field(default_factory=list)
    goal: ActionMessage | None = None
    begin: int = 0

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
        before = task.goal.order if task.goal is not None else _first_order_after(recording, earliest)
        ended = max((t.end + 1 for t in tasks if t.manager == task.manager and t.end < first.order), default=0)
        task.begin = max(before, ended)
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
        and not any(_MODULE in element._props for element in event.change.elements)
        and (event.change.elements or event.change.relations)
    ]


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


def tick_times(progress: Sequence[TaskProgress]) -> list[float]:
    """Returns the time of the tick before each progress message (s, recording time), in ascending order.

    Message times lag some milliseconds. Each node reports the exact time from its start to its last report, so the
    times between ticks are known; only the first is taken from the bag.
    """
    times: list[float] = []
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
        time = min(max(known), latest + 0.05) if known else latest
        times.append(max(time, times[-1]) if times else time)
        for path, node in fresh.items():
            if path not in begun or path not in before or node.run_time < before[path].run_time or (
                before[path].state == IDLE
            ):  # fmt: skip
                begun[path] = times[-1] - node.run_time
        before = now
    return times
