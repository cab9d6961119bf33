"""The list of tasks of all robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.names import local_name
from skiros2_skill.core.runtime.history import one_line

#: The values of `SkillProgress.state`.
SUCCESS, FAILURE, RUNNING, IDLE = 1, 2, 3, 4

#: The most ended tasks kept.
MAX_ENDED = 50

#: Without a message for this time a running task counts as silent (s). Managers publish once a second.
SILENCE_TIMEOUT = 5.0

Key = tuple[str, int]


@dataclass(frozen=True)
class TaskRow:
    """:param manager: the node name of the robot's manager.
    :param skill: the names of its skills.
    :param state: `running`, `paused`, `succeeded`, `failed`, or `lost` if the robot has disconnected.
    :param message: its message, in one line.
    :param start: the time of its first message (s since the epoch).
    :param updated: the time of its last message (s since the epoch).
    """

    manager: str
    task: int
    skill: str
    state: str
    message: str
    start: float
    updated: float

    @property
    def key(self) -> Key:
        return (self.manager, self.task)

    def state_at(self, now: float) -> str:
        """Returns the displayed state: `silent` for a running task without recent messages.

        :param now: s since the epoch.
        """
        return "silent" if self.state == "running" and now - self.updated > SILENCE_TIMEOUT else self.state

    @property
    def is_finished(self) -> bool:
        return self.state not in ("running", "paused")


class TaskRows:
    """Collects the progress of tasks. For one thread."""

    def __init__(self) -> None:
        self._rows: dict[Key, TaskRow] = {}

    @property
    def rows(self) -> list[TaskRow]:
        """Running tasks, then ended ones; the newest first."""
        return sorted(self._rows.values(), key=lambda row: (row.is_finished, -row.start, row.key))

    def get(self, key: Key | None) -> TaskRow | None:
        return self._rows.get(key) if key is not None else None

    def update(self, manager: str, nodes: Sequence[Any], stamp: float) -> bool:
        """Updates a task. Returns whether anything but the time has changed.

        :param nodes: a `SkillProgress` for each node, the root first.
        """
        if not nodes:
            return False
        root = nodes[0]
        key = (manager, int(root.id))
        known = self._rows.get(key)
        if known is not None and known.is_finished and abs(root.progress_code) != 1:
            known = None  # the manager has restarted and reuses ids
        state = _state(root)
        if known is not None and stamp < known.updated and state in ("running", "paused"):
            return False  # a later response was processed already
        row = TaskRow(
            manager,
            key[1],
            _skill(nodes) or (known.skill if known is not None else ""),
            state,
            _message(nodes, state),
            known.start if known is not None else stamp,
            stamp,
        )
        self._rows[key] = row
        if row.is_finished:
            self._drop_oldest()
        return known is None or (known.state, known.message, known.skill) != (row.state, row.message, row.skill)

    def add(self, manager: str, task: int, skill: str, stamp: float) -> None:
        """Adds a started task without progress."""
        self._rows[(manager, task)] = TaskRow(manager, task, skill, "running", "", stamp, stamp)

    def mark_lost(self, manager: str) -> bool:
        """Marks the running tasks of a manager as lost. Returns whether there were any."""
        lost = [row for row in self._rows.values() if row.manager == manager and not row.is_finished]
        for row in lost:
            self._rows[row.key] = TaskRow(
                manager, row.task, row.skill, "lost", "the robot has disconnected", row.start, row.updated
            )
        return bool(lost)

    def clear_ended(self) -> None:
        """Removes the tasks that have ended."""
        self._rows = {key: row for key, row in self._rows.items() if not row.is_finished}

    def _drop_oldest(self) -> None:
        ended = sorted((row for row in self._rows.values() if row.is_finished), key=lambda row: row.updated)
        for row in ended[:-MAX_ENDED]:
            del self._rows[row.key]


def _state(root: Any) -> str:
    if abs(root.progress_code) == 1:
        return "succeeded" if root.state == SUCCESS else "failed"
    # The root has a message only while the task is paused.
    return "paused" if root.progress_message else "running"


def _skill(nodes: Sequence[Any]) -> str:
    """Returns the names of the skills below the root."""
    root = nodes[0].id
    names = [n.label or local_name(n.type) for n in nodes[1:] if n.parent_id == root]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


def _message(nodes: Sequence[Any], state: str) -> str:
    """Returns the root's message if the task has ended or is paused, else that of the deepest running node."""
    text = nodes[0].progress_message
    if state == "running":
        running = [n for n in nodes[1:] if n.state == RUNNING]
        last = running[-1] if running else None
        if last is not None:
            name = last.label or local_name(last.type)
            text = f"{name}: {last.progress_message}" if last.progress_message else name
    line = one_line(text)
    return "" if state == "paused" and line == "paused" else line
