"""What is done before each step of the world."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol


class Stepped(Protocol):
    """Something that is done a little before each step, until it has an outcome."""

    @property
    def outcome(self) -> object | None:
        """How it ended; None while it goes on."""
        ...

    def update(self, dt: float) -> None:
        """What is to be done before the next step, of `dt` seconds."""
        ...


class Motions:
    """The motions that go on, in the order in which they were added."""

    def __init__(self) -> None:
        self._going: list[Stepped] = []

    def __iter__(self) -> Iterator[Stepped]:
        return iter(tuple(self._going))

    def __len__(self) -> int:
        return len(self._going)

    def add(self, motion: Stepped) -> None:
        """Goes on with a motion from the next step on, until it has an outcome."""
        if motion not in self._going:
            self._going.append(motion)

    def remove(self, motion: Stepped) -> None:
        """Forgets a motion, if it is there."""
        if motion in self._going:
            self._going.remove(motion)

    def update(self, dt: float) -> None:
        """Goes on with each. One that raises an error, or has an outcome, is forgotten; the error comes out."""
        for motion in self:
            going = False
            try:
                motion.update(dt)
                going = motion.outcome is None
            finally:
                if not going:
                    self.remove(motion)
