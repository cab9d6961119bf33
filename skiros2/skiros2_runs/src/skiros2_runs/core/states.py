"""The states of nodes and of tasks, and the style of each: symbol, word and colour role."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum


class NodeState(IntEnum):
    """The values of `SkillProgress.state`."""

    SUCCESS = 1
    FAILURE = 2
    RUNNING = 3
    IDLE = 4


SUCCESS, FAILURE, RUNNING, IDLE = NodeState

#: The states of a node that has ended.
ENDS = (SUCCESS, FAILURE)


class TaskState(StrEnum):
    """The state of a task.

    `ENDING` is a preempted task that runs an `on_preempt` of its skills, or is about to. `PREEMPTED` is a task that
    failed because it was preempted by a command. `LOST` is a task whose manager has disconnected while it was running.
    """

    RUNNING = "running"
    PAUSED = "paused"
    ENDING = "ending"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    PREEMPTED = "preempted"
    LOST = "lost"

    @property
    def has_ended(self) -> bool:
        """Whether the manager has reported the end of the task."""
        return self in (TaskState.SUCCEEDED, TaskState.FAILED, TaskState.PREEMPTED)


@dataclass(frozen=True)
class StateStyle:
    """How a state is shown.

    :param symbol: one character.
    :param ascii: the same for terminals without such characters.
    :param word: fits after "is" or "has".
    :param colour_role: a key of `ROLE_COLOURS`.
    """

    symbol: str
    ascii: str
    word: str
    colour_role: str


#: The colour of each role on a light and on a dark background.
ROLE_COLOURS = {
    "success": ("#1b7f3b", "#5fd38d"),
    "failure": ("#b3261e", "#ff8a80"),
    "running": ("#1f6fb2", "#6db3f2"),
    "paused": ("#8a5a00", "#f2c14e"),
    "idle": ("#75797d", "#8b9095"),
    "changed": ("#8a5a00", "#f2c14e"),
}

_STYLES: dict[int | TaskState, StateStyle] = {
    SUCCESS: StateStyle("✓", "+", "succeeded", "success"),
    FAILURE: StateStyle("✗", "x", "failed", "failure"),
    RUNNING: StateStyle("▶", ">", "running", "running"),
    IDLE: StateStyle("○", ".", "idle", "idle"),
    TaskState.RUNNING: StateStyle("▶", ">", "running", "running"),
    TaskState.PAUSED: StateStyle("‖", "=", "paused", "paused"),
    TaskState.ENDING: StateStyle("▼", "v", "ending", "paused"),
    TaskState.SUCCEEDED: StateStyle("✓", "+", "succeeded", "success"),
    TaskState.FAILED: StateStyle("✗", "x", "failed", "failure"),
    TaskState.PREEMPTED: StateStyle("■", "#", "preempted", "paused"),
    TaskState.LOST: StateStyle("?", "?", "lost: its end was not reported", "failure"),
}

#: The style of any other value.
_UNKNOWN = StateStyle("?", "?", "in an unknown state", "changed")


def style_of(state: int | TaskState) -> StateStyle:
    """Returns the style of a node's or a task's state; unknown values have one too."""
    return _STYLES.get(state, _UNKNOWN)


def state_name(state: int) -> str:
    """Returns the name of a node's state in data: `success`, `failure`, `running`, `idle` or `unknown`."""
    return NodeState(state).name.lower() if state in [*NodeState] else "unknown"
