"""What all motions of simulated robots have in common.

A motion is a state machine beside the physics: whoever steps the world calls `update` before each step, until there is
an `outcome`. A goal that cannot be is no error here: its motion has its outcome at once and nothing moves. All run in
the thread that steps the world.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Protocol


class State(IntEnum):
    """How a motion ended, numbered as in actionlib_msgs/GoalStatus."""

    PREEMPTED = 2
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5  # its goal cannot be: nothing has moved


class Outcome(NamedTuple):
    """How a motion ended: the reason in words, and the error code of its action's result, where that has one."""

    state: State
    text: str = ""
    code: int = 0


class Motion(Protocol):
    """Something that moves a part of a robot to an end."""

    @property
    def outcome(self) -> Outcome | None:
        """None while it runs."""
        ...

    def update(self, dt: float) -> None:
        """Called before each step of the world, `dt` (s) being its length."""
        ...

    def cancel(self) -> None:
        """Brakes; the outcome follows in one of the next updates."""
        ...
