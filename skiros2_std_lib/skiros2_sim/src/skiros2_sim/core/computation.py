"""Long computations of motions, a few pieces in each step of the world.

The thread that steps the world also publishes clock and tf and moves all robots: a computation must not hold it up. A
fixed number of pieces in each step limits the time, and the result is there at a simulated time that does not depend
on the speed of the machine: runs from one seed are identical.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

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
