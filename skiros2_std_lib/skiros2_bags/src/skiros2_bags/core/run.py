"""A recorded run: the world model at any time, what each task did, when skills ran, and what came of actions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from os import PathLike
from pathlib import Path

from skiros2_bags.core.action_call import ActionCall, action_calls, action_topics, topics_of
from skiros2_bags.core.bag_file import BagFile
from skiros2_bags.core.contract_types import MONITOR, PROGRESS
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.goal import Goal, goals_among
from skiros2_bags.core.message import Message
from skiros2_bags.core.skill_time import SkillTime, skill_times
from skiros2_bags.core.task_trace import TaskTrace, task_traces
from skiros2_bags.core.world_changes import TimedChange, timed_changes
from skiros2_bags.core.world_history import world_at
from skiros2_world_model.core.scene import Scene


class Run:
    """What a bag holds of a run. No ROS is needed. What is asked for is read then, once; one thread at a time.

    All times are those of the bag, in s since the epoch: when a message was recorded.
    """

    def __init__(self, bag: BagFile) -> None:
        self.bag = bag

    @classmethod
    def open(cls, path: str | PathLike[str]) -> Run:
        """The run in a bag.

        :raises BagError: there is no such file, or it is no bag. One that was cut off is read as far as it goes.
        """
        return cls(BagFile(Path(path)))

    @property
    def path(self) -> Path:
        return self.bag.path

    @property
    def start(self) -> float:
        """When the first message was recorded; 0 for a bag without messages."""
        return self.bag.start

    @property
    def end(self) -> float:
        """When the last message was recorded."""
        return self.bag.end

    @property
    def damage(self) -> str:
        """Where and why the bag ends early; "" when it is whole."""
        return self.bag.damage

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        return self.bag.topics

    def messages(self, *wanted: str) -> Iterator[Message]:
        """The messages of some topics (`/tf`) or types (`tf2_msgs/TFMessage`), oldest first; of none given, all.

        :raises BagError: the bag cannot be read.
        """
        return self.bag.messages(*wanted)

    def world(self, at: float | None = None, partial: bool = False) -> Scene:
        """The scene at a time, with all that was recorded up to then; the caller's own.

        :param at: None: the end.
        :param partial: what is known although changes are missing in the bag.
        :raises BagError: there is none yet at that time, changes before it are missing, or one cannot be read.
        """
        return world_at(self.changes(), self.end if at is None else at, partial)

    def changes(self) -> list[TimedChange]:
        """The changes of the world model, in the order in which they were made.

        :raises BagError: the bag has no such messages, or one cannot be read.
        """
        return self._changes

    def tasks(self) -> list[TaskTrace]:
        """The tasks of all skill managers, in the order in which they began.

        :raises BagError: the bag has no progress of tasks, or one cannot be read.
        """
        return self._tasks

    def skills(self) -> list[SkillTime]:
        """The runs of all skills, ordered by start.

        :raises BagError: as for `tasks`.
        """
        return skill_times(self._tasks)

    def actions(self) -> list[ActionCall]:
        """The goals of all actions, in the order in which they were first heard of.

        :raises BagError: one cannot be read.
        """
        return self._actions

    def goals(self) -> list[Goal]:
        """What task managers were asked to reach, oldest first.

        :raises BagError: one cannot be read.
        """
        return goals_among(self._actions)

    @cached_property
    def _changes(self) -> list[TimedChange]:
        self._need(MONITOR, "changes of the world model")
        return timed_changes(self.messages(MONITOR))

    @cached_property
    def _tasks(self) -> list[TaskTrace]:
        self._need(PROGRESS, "progress of tasks")
        return task_traces(self.messages(PROGRESS))

    @cached_property
    def _actions(self) -> list[ActionCall]:
        actions = action_topics(self.topics)
        return action_calls(self.messages(*topics_of(actions)), actions) if actions else []

    def _need(self, message_type: str, what: str) -> None:
        if message_type not in self.topics.values():
            raise BagError(f"{self.path}: the bag holds no {what}: expected a topic of the type {message_type}")
