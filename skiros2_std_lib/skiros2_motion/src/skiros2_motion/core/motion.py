"""The interface of all motions of simulated robots.

A motion is a state machine: the owner of the world calls `update` before each step, until the motion has an `outcome`.
An invalid goal is not an exception: the motion has the outcome `REJECTED` immediately. All calls are made by the
stepping thread.

That thread also publishes clock and tf and moves all robots: a long computation must not hold it up. So a motion
computes a fixed number of pieces in each step. The result is there at a simulated time that does not depend on the
speed of the machine: runs from one seed are identical.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from enum import IntEnum
from typing import NamedTuple, Protocol, TypeVar


class State(IntEnum):
    """Final state of a motion, numbered as in actionlib_msgs/GoalStatus."""

    PREEMPTED = 2
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5  # invalid goal: nothing has moved


class Outcome(NamedTuple):
    """Result of a motion: state, reason, and error code of the action's result, if it has one."""

    state: State
    text: str = ""
    code: int = 0


class Motion(Protocol):
    """Moves a part of a robot."""

    @property
    def outcome(self) -> Outcome | None:
        """None while it runs."""
        ...

    def update(self, dt: float) -> None:
        """Called before each step of the world, of `dt` seconds."""
        ...

    def cancel(self) -> None:
        """Brakes; the outcome follows in a later update."""
        ...


class Steppable(Protocol):
    """Something that is updated before each step, until it has an outcome."""

    @property
    def outcome(self) -> object | None:
        """The result; None while it is active."""
        ...

    def update(self, dt: float) -> None:
        """Called before each step, of `dt` seconds."""
        ...


class MotionList:
    """The active motions, in the order of addition."""

    def __init__(self) -> None:
        self._active: list[Steppable] = []

    def __iter__(self) -> Iterator[Steppable]:
        return iter(tuple(self._active))

    def __len__(self) -> int:
        return len(self._active)

    def add(self, motion: Steppable) -> None:
        """Updates a motion from the next step on, until it has an outcome."""
        if motion not in self._active:
            self._active.append(motion)

    def remove(self, motion: Steppable) -> None:
        """Removes a motion, if it is active."""
        if motion in self._active:
            self._active.remove(motion)

    def update(self, dt: float) -> None:
        """Updates all motions. Removes those that have an outcome or raise an exception; the exception propagates."""
        for motion in self:
            active = False
            try:
                motion.update(dt)
                active = motion.outcome is None
            finally:
                if not active:
                    self.remove(motion)


T = TypeVar("T")

#: Yields after each piece of work; returns the result.
Pieces = Generator[None, None, T]


def advance(computation: Pieces[T], pieces: int) -> T | None:
    """Computes at most `pieces` pieces. Returns the result when it is there, else None; errors propagate."""
    for _ in range(pieces):
        try:
            next(computation)
        except StopIteration as end:
            result: T = end.value
            return result
    return None


def complete(computation: Pieces[T]) -> T:
    """Computes all remaining pieces. Returns the result; errors propagate."""
    while True:
        try:
            next(computation)
        except StopIteration as end:
            result: T = end.value
            return result
