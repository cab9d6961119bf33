"""Reads the progress of a task: the fields of `SkillProgress` of its nodes.

The fields of the message are fixed. The root has an additional parameter `STATUS_KEY` while the task is paused or
ending, and after it was preempted. Parameters are named values, so that other receivers may ignore it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Protocol

from skiros2_runs.core.states import SUCCESS, TaskState

#: The types of a task's root, and of nodes that only group others.
ROOT_TYPE, GROUP_TYPE = ":Root", ":Skill"
#: The type of the root of a goal, which is no message of a manager; see `goal_runs`.
GOAL_TYPE = ":Goal"

#: The key of the root's parameter whose value is a `TaskState`: `PAUSED`, `ENDING` or `PREEMPTED`.
STATUS_KEY = "TaskStatus"

#: The code of an optional parameter in messages.
_OPTIONAL = 1


class NodeMessage(Protocol):
    """A `SkillProgress`, as ROS or a bag reader deserialises it."""

    @property
    def robot(self) -> str: ...
    @property
    def task_id(self) -> int: ...
    @property
    def id(self) -> int: ...
    @property
    def parent_id(self) -> int: ...
    @property
    def type(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def params(self) -> Sequence[Any]: ...
    @property
    def processor(self) -> str: ...
    @property
    def state(self) -> int: ...
    @property
    def progress_code(self) -> int: ...
    @property
    def progress_time(self) -> float: ...
    @property
    def progress_message(self) -> str: ...


def has_ended(nodes: Sequence[NodeMessage]) -> bool:
    """Returns whether a message is the last one of its task.

    :param nodes: the root first.
    """
    return bool(abs(nodes[0].progress_code) == 1)


def task_state(root: NodeMessage) -> TaskState:
    """Returns the state of a task, from the progress of its root."""
    status = _status(root)
    if abs(root.progress_code) != 1:
        return TaskState(status) if status in (TaskState.PAUSED, TaskState.ENDING) else TaskState.RUNNING
    if root.state == SUCCESS:
        return TaskState.SUCCEEDED
    return TaskState.PREEMPTED if status == TaskState.PREEMPTED else TaskState.FAILED


def status_text(status: TaskState) -> str:
    """Returns the root's parameter with the status of a task, as JSON."""
    description = "The status of the task"
    return json.dumps(
        {"key": STATUS_KEY, "description": description, "specType": _OPTIONAL, "type": "str", "values": [status]}
    )


def _status(root: NodeMessage) -> str:
    for param in root.params:
        if STATUS_KEY in param.param:
            try:
                data = json.loads(param.param)
                if data["key"] == STATUS_KEY:
                    return str(data["values"][0])
            except (ValueError, KeyError, IndexError, TypeError):
                continue
    return ""
