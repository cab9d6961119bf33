"""The tasks in a recording: what was asked for, and what was told of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.testing.recording import Acted, Changed, Events, Told

#: What skills have that were registered.
_MODULE = "skiros:PythonModule"

#: A task whose start is not in the bag began at most so long before it was first told of (s).
_BEFORE_FIRST = 0.5


@dataclass
class TaskRun:
    """A task from its start to its end.

    :param told: its progress, oldest first; the same told again is left out.
    :param goal: what asked for it; None: that was a command by service, which no bag has.
    :param begin: the order of the first message that may be of its doing.
    """

    manager: str
    task: int
    told: list[Told] = field(default_factory=list)
    goal: Acted | None = None
    begin: int = 0

    @property
    def end(self) -> int:
        """The order of the last message."""
        return self.told[-1].order

    @property
    def ended(self) -> bool:
        """Whether its end is in the bag."""
        return abs(self.told[-1].nodes[0].code) == 1

    @property
    def skills(self) -> Sequence[Any]:
        """What was asked for, as `ResourceDescription`s; none when that is not known."""
        return self.goal.content.skills if self.goal is not None else ()

    def __str__(self) -> str:
        labels = ", ".join(n.name for n in self.told[0].nodes if len(n.place) == 1)
        return f"task {self.task} of {self.manager} ({labels})"


def task_runs(recording: Events) -> list[TaskRun]:
    """The tasks of all managers, in the order in which they were first told of."""
    runs: list[TaskRun] = []
    open_runs: dict[tuple[str, int], TaskRun] = {}
    for message in recording.told:
        key = message.manager, message.task
        run = open_runs.get(key)
        if run is None:
            run = open_runs[key] = TaskRun(*key)
            runs.append(run)
        last = run.told[-1] if run.told else None
        if last is None or last.nodes != message.nodes or _seconds(last) != _seconds(message):
            run.told.append(message)
        if abs(message.nodes[0].code) == 1 and message.nodes[0].state in "SF":
            del open_runs[key]
    goals = _goals_of(recording, runs)
    for run in runs:
        first = run.told[0]
        run.goal = goals.get(id(run))
        before = run.goal.order if run.goal is not None else _first_after(recording, first.time - _BEFORE_FIRST)
        ended = max((r.end + 1 for r in runs if r.manager == run.manager and r.end < first.order), default=0)
        run.begin = max(before, ended)
    return runs


def changes_of_tasks(events: Events, runs: Sequence[TaskRun]) -> list[Changed]:
    """What the managers of some tasks have changed since the first of these began, but for the skills they registered.

    The end of a task is no end for its changes: what the world model tells may come later than what the manager tells.
    """
    begin = {run.manager: min(r.begin for r in runs if r.manager == run.manager) for run in runs}
    return [
        event
        for event in events.changes
        if event.order >= begin.get(event.change.author, math.inf)
        and not any(_MODULE in element._props for element in event.change.elements)
        and (event.change.elements or event.change.relations)
    ]


def _goals_of(recording: Events, runs: Sequence[TaskRun]) -> dict[int, Acted]:
    """The goal of each task, by the task's identity: feedback and result name the task."""
    found: dict[int, Acted] = {}
    for event in recording.acted:
        if event.part not in ("feedback", "result") or not event.action.endswith("/execute"):
            continue
        manager = event.action.removesuffix("/execute")
        same = [r for r in runs if (r.manager, r.task) == (manager, getattr(event.content, "task_id", -1))]
        goals = [g for g in recording.goals(event.action) if g.goal_id == event.goal_id]
        for run in same:
            if goals and goals[0].time <= run.told[0].time + _BEFORE_FIRST:
                found.setdefault(id(run), goals[0])
    return found


def _first_after(recording: Events, time: float) -> int:
    return next((e.order for e in recording.events if e.time >= time), 0)


def _seconds(message: Told) -> list[float]:
    return [node.seconds for node in message.nodes]
