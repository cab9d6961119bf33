"""A recorded run: world model, tasks, skills, actions and goals; and whether its bag is complete."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

from skiros2_bags.core.action_call import (
    ActionCall,
    Goal,
    action_calls,
    action_topic_names,
    action_topics,
    planning_goals,
)
from skiros2_bags.core.bag_file import MONITOR, PROGRESS, BagError, BagFile, Message
from skiros2_bags.core.bag_writer import PARAMETERS
from skiros2_bags.core.world_history import TimedChange, timed_changes, world_at
from skiros2_live.core.patch import TaskProgress
from skiros2_runs.core.history import SkillRecord, skill_runs
from skiros2_runs.core.runs import Runs
from skiros2_runs.core.task_run import Recorded, TaskRun
from skiros2_world_model.core.scene import Scene

#: The most memory for ticks of tasks (bytes), and the most tasks; older ones are discarded.
_MAX_KEPT, _MAX_TASKS = 1_000_000_000, 100_000


class Run:
    """The run in a bag. Needs no ROS. Reads on first access and caches. Not thread-safe.

    All times are recording times in s since the epoch.
    """

    def __init__(self, bag: BagFile) -> None:
        self.bag = bag

    @classmethod
    def open(cls, path: str | PathLike[str]) -> Run:
        """Opens a bag. A truncated bag is read up to its last complete record.

        :raises BagError: the file does not exist or is not a bag.
        """
        return cls(BagFile(Path(path)))

    @property
    def path(self) -> Path:
        return self.bag.path

    @property
    def start(self) -> float:
        """Time of the first message; 0 for a bag without messages."""
        return self.bag.start

    @property
    def end(self) -> float:
        """Time of the last message."""
        return self.bag.end

    @property
    def damage(self) -> str:
        """Where and why the bag ends early; "" for a complete bag."""
        return self.bag.damage

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        return self.bag.topics

    def messages(self, *wanted: str) -> Iterator[Message]:
        """Yields the messages of topics (`/tf`) or types (`tf2_msgs/TFMessage`), oldest first; by default all messages.

        :raises BagError: the bag cannot be read.
        """
        return self.bag.messages(*wanted)

    def world(self, at: float | None = None, partial: bool = False) -> Scene:
        """Returns a new scene with all changes recorded up to a time.

        :param at: None for the end.
        :param partial: whether missing changes are accepted.
        :raises BagError: there is no scene yet at that time, changes before it are missing, or one cannot be read.
        """
        return world_at(self.changes(), self.end if at is None else at, partial)

    def changes(self) -> list[TimedChange]:
        """Returns the changes of the world model, in order.

        :raises BagError: the bag has no such messages, or one cannot be read.
        """
        return self._changes

    def tasks(self) -> list[TaskRun]:
        """Returns the tasks of all skill managers, ordered by start.

        :raises BagError: the bag has no progress of tasks, or a message cannot be read.
        """
        return list(self.runs())

    def runs(self) -> Runs:
        """Returns the tasks as `tasks` does.

        :raises BagError: the bag has no progress of tasks, or a message cannot be read.
        """
        return self._runs

    def skills(self) -> list[SkillRecord]:
        """Returns the runs of all skills, ordered by start.

        :raises BagError: as for `tasks`.
        """
        return skill_runs(self._runs)

    def actions(self) -> list[ActionCall]:
        """Returns the goals of all actions, in the order of their first message.

        :raises BagError: a message cannot be read.
        """
        return self._actions

    def goals(self) -> list[Goal]:
        """Returns the goals for task managers, oldest first.

        :raises BagError: a message cannot be read.
        """
        return planning_goals(self._actions)

    def robot_descriptions(self) -> dict[str, tuple[str, str]]:
        """Returns the URDF and the tf prefix of each recorded `robot_description` by the name of its namespace.

        :raises BagError: a message cannot be read.
        """
        found: dict[str, tuple[str, str]] = {}
        for message in self.messages(PARAMETERS):
            found.update(_descriptions(json.loads(message.content.data)))
        return found

    @cached_property
    def _changes(self) -> list[TimedChange]:
        self.need(MONITOR, "changes of the world model")
        return timed_changes(self.messages(MONITOR))

    @cached_property
    def _runs(self) -> Runs:
        self.need(PROGRESS, "progress of tasks")
        runs = new_runs()
        for message in self.messages(PROGRESS):
            add_progress(runs, message)
        return runs

    @cached_property
    def _actions(self) -> list[ActionCall]:
        actions = action_topics(self.topics)
        return action_calls(self.messages(*action_topic_names(actions)), actions) if actions else []

    def need(self, message_type: str, what: str) -> None:
        """
        :raises BagError: the bag has no topic of this type, which holds `what`.
        """
        if message_type not in self.topics.values():
            holder = f"{self.damage}; it" if self.damage else f"{self.path}: the bag"
            raise BagError(f"{holder} holds no {what}: expected a topic of the type {message_type}")


def _descriptions(parameters: Any, name: str = "") -> Iterator[tuple[str, tuple[str, str]]]:
    if not isinstance(parameters, dict):
        return
    if isinstance(parameters.get("robot_description"), str):
        yield name, (parameters["robot_description"], str(parameters.get("tf_prefix", "")))
    for key, value in parameters.items():
        yield from _descriptions(value, f"{name}_{key}".strip("_"))


def new_runs() -> Runs:
    """Returns runs that keep the tasks of a bag."""
    return Runs(most_bytes=_MAX_KEPT, most_tasks=_MAX_TASKS)


def progress_of(message: Message) -> TaskProgress:
    """Returns a message with the progress of a task.

    :raises BagError: it cannot be read, or does not begin with the root of a task.
    """
    nodes = message.content.progress
    if nodes and nodes[0].id != nodes[0].task_id:
        begin = f"begins with node {nodes[0].id}, expected its root"
        raise BagError(f"{message.location}: the progress of task {nodes[0].task_id} {begin}")
    robot = nodes[0].robot or message.topic.removesuffix("/monitor") if nodes else ""
    return TaskProgress(robot, nodes, message.time)


def add_progress(runs: Runs, message: Message) -> Recorded | None:
    """Records a message with the progress of a task.

    :returns: see `Runs.record`.
    :raises BagError: see `progress_of`.
    """
    patch = progress_of(message)
    return runs.record(patch.manager, patch.nodes, patch.stamp)


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    :param holds: whether the check passed.
    :param text: for people.
    """

    holds: bool
    text: str


def check(run: Run) -> list[Finding]:
    """Checks the file, the continuity of the world model's changes, the tasks and the goals of actions."""
    findings = [Finding(False, run.damage) if run.damage else Finding(True, "the file is whole")]
    for check_part in (_check_world, _check_tasks, _check_actions):
        try:
            findings += check_part(run)
        except BagError as error:
            findings.append(Finding(False, str(error)))
    return findings


def _check_world(run: Run) -> Iterator[Finding]:
    if MONITOR not in run.topics.values():
        yield Finding(False, "no change of a world model was recorded")
        return
    changes = run.changes()
    gaps = [timed for timed in changes if timed.gap]
    yield from (Finding(False, f"at {_time(run, timed.time)} {timed.gap}") for timed in gaps)
    if not gaps:
        elements = len(changes[0].change.elements) if changes else 0
        yield Finding(
            True, f"{len(changes)} changes follow one another without a gap, from a scene of {elements} elements"
        )


def _check_tasks(run: Run) -> Iterator[Finding]:
    if PROGRESS not in run.topics.values():
        yield Finding(True, "no task was run")
        return
    tasks = run.tasks()
    late = [task for task in tasks if not task.is_complete]
    for task in late:
        yield Finding(False, f"{task.robot}, task {task.task_id}: it was running before {_time(run, task.start)}")
    if not late:
        running = [f"task {task.task_id} of {task.robot}" for task in tasks if not task.latest.has_ended]
        ended = f"; not ended: {', '.join(running)}" if running else ""
        yield Finding(True, f"{len(tasks)} tasks are complete from their start{ended}")


def _check_actions(run: Run) -> Iterator[Finding]:
    calls = run.actions()
    bad = 0
    for call in calls:
        if call.goal is None:
            bad += 1
            yield Finding(False, f"{call.name}: the goal {call.goal_id!r} was sent before the recorder subscribed")
        elif call.status is None:
            bad += 1
            yield Finding(False, f"{call.name}: no answer to the goal sent at {_time(run, call.goal.time)}")
    if not bad:
        yield Finding(True, f"{len(calls)} goals of actions are complete, each with an answer")


def _time(run: Run, time: float) -> str:
    return f"{time - run.start:.3f} s"
