"""Which task has left an arm with its compliant controller active. If it is not active when the next skill of the task
starts, somebody else has switched it off. Thread-safe."""

from __future__ import annotations

_left: dict[str, object] = {}


def leave_compliant(arm: str, task: object) -> None:
    """A skill of a task leaves an arm compliant.

    :param arm: id of the element.
    :param task: as of `skiros2_common.core.task_context`.
    """
    _left[arm] = task


def forget(arm: str) -> None:
    """A skill switches the controllers of an arm."""
    _left.pop(arm, None)


def is_left_compliant(arm: str, task: object) -> bool:
    """Whether a skill of this task has left the arm compliant, and none has switched its controllers since."""
    return task is not None and _left.get(arm) is task
