"""Which task, or goal, has left an arm with its compliant controller active. If it is not active when the next skill of
the same task or goal starts, somebody else has switched it off; if the arm has stopped since, somebody has hit it.
Thread-safe."""

from __future__ import annotations

#: By arm: the task, and whether its skill has succeeded without a stop.
_left: dict[str, tuple[object, bool]] = {}


def leave_compliant(arm: str, task: object, succeeded: bool = False) -> None:
    """A skill of a task leaves an arm compliant.

    :param arm: id of the element.
    :param task: as of `skiros2_common.core.task_context`.
    :param succeeded: whether the skill has, without a stop of the arm.
    """
    _left[arm] = task, succeeded


def forget(arm: str) -> None:
    """A skill switches the controllers of an arm."""
    _left.pop(arm, None)


def is_left_compliant(arm: str, task: object) -> bool:
    """Whether a skill of this task has left the arm compliant, and none has switched its controllers since."""
    return task is not None and _left.get(arm, (None, False))[0] == task


def is_left_in_order(arm: str) -> bool:
    """Whether the skill that has left the arm compliant has succeeded, without a stop."""
    return _left.get(arm, (None, False))[1]
