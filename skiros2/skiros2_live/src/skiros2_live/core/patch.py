"""Patches: what has changed in the running cell, as the adapters over ROS and bags report it to `CellDocument`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

#: The tables of a document with plain (JSON) data.
Table = Literal["elements", "frames", "bodies", "signals"]

#: The parts of a system beside its robots.
MASTER, WORLD_MODEL, TASK_MANAGER = "ROS master", "world model", "task manager"


@dataclass(frozen=True)
class Connection:
    """A part of the system beside its robots has connected or disconnected, or the details have changed.

    :param name: one of the constants above.
    :param address: its node name; of the master: the URI.
    :param since: when it connected or disconnected (s since the epoch); 0.0: it has never been up.
    :param text: details for people.
    """

    name: str
    address: str
    is_up: bool
    since: float
    text: str = ""

    def updated(self, is_up: bool, text: str = "") -> Connection:
        """Returns the connection with a status found now."""
        return replace(self, is_up=is_up, since=self.since if is_up == self.is_up else time.time(), text=text)


@dataclass(frozen=True)
class ManagerConnection:
    """A skill manager has connected or disconnected.

    :param manager: the manager's node name.
    """

    manager: str
    is_connected: bool


@dataclass(frozen=True)
class SafetyChanged:
    """The safety state of a robot, as of `SafetyStatus`.

    :param manager: the node name of its manager.
    :param since: when the state has begun (s since the epoch).
    """

    manager: str
    state: str
    reason: str
    stops: tuple[str, ...]
    since: float


@dataclass(frozen=True)
class TaskProgress:
    """A manager has published the state of a task.

    :param manager: the manager's node name.
    :param nodes: a `SkillProgress` (or an object with its fields) for each node, parents before children, the root
        first.
    :param stamp: when it was received (s since the epoch).
    :param is_past: whether the task had ended before: its end counts for a task that is known and has not ended.
    """

    manager: str
    nodes: Sequence[Any]
    stamp: float
    is_past: bool = False

    @property
    def task(self) -> int:
        """The task's id."""
        return int(self.nodes[0].id)


@dataclass(frozen=True, eq=False)
class GoalProgress:
    """A message of a goal of any client.

    :param message: an `AchieveActionGoal`, `AchieveActionFeedback` or `AchieveActionResult`.
    :param stamp: when it was received (s since the epoch).
    """

    goal_id: str
    message: Any
    stamp: float


@dataclass(frozen=True)
class EntriesChanged:
    """Entries of a table have changed.

    :param entries: JSON data by key; None: the entry was removed.
    :param is_whole: whether they replace the table.
    """

    table: Table
    entries: Mapping[str, Any]
    is_whole: bool = False


Patch = Connection | ManagerConnection | SafetyChanged | TaskProgress | GoalProgress | EntriesChanged
