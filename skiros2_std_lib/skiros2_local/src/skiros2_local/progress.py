"""The progress of a task as views of tasks read it, without messages."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_common.core.abstract_skill import State
from skiros2_runs.core.progress import NodeMessage, status_text
from skiros2_runs.core.states import NodeState, TaskState
from skiros2_skill.core.runtime.task import Task

_STATES = {
    State.Success: NodeState.SUCCESS,
    State.Failure: NodeState.FAILURE,
    State.Running: NodeState.RUNNING,
    State.Idle: NodeState.IDLE,
    State.Uninitialized: NodeState.IDLE,
}
_REPORTED = (TaskState.PAUSED, TaskState.ENDING, TaskState.PREEMPTED)


@dataclass(frozen=True)
class ParamText:
    """A parameter as JSON, as a `Param` message has it."""

    param: str


@dataclass(frozen=True)
class LocalProgress:
    """The progress of a node; see `NodeMessage`."""

    robot: str
    task_id: int
    id: int
    parent_id: int
    type: str
    label: str
    params: tuple[ParamText, ...]
    processor: str
    state: int
    progress_code: int
    progress_time: float
    progress_message: str


def progress_of(task: Task, robot: str) -> list[NodeMessage]:
    """Returns the present progress of each node of a task, parents before children. Any thread.

    :param robot: the name of its robot.
    """
    status = (ParamText(status_text(task.status)),) if task.status in _REPORTED else ()
    return [
        LocalProgress(
            robot, task.id, node.id, node.parent_id, node.type, node.label, () if index else status, node.processor,
            _STATES[node.state], node.progress_code, node.progress_time, node.progress_message,
        )
        for index, node in enumerate(task.progress())
    ]  # fmt: skip
