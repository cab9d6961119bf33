"""An element that is dragged: which of the poses that come with each move of the mouse are written."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_std_reasoners.core.geometry import Pose

#: A pose is written this long after the last one, at the earliest (s).
PERIOD = 0.1

#: A drag of which nothing is heard for so long has ended (s); while the mouse is held still, views say so more often.
SILENCE = 2.0


@dataclass(frozen=True)
class Target:
    """Where an element is to go.

    :param frame: the frame that `pose` is in.
    """

    id: str
    frame: str
    pose: Pose


class Dragging:
    """Keeps the newest target and says when it is to be written: not too often, and the last one for sure.

    Used by one thread, or under its user's lock. Times are those of a clock that does not go back (s).
    """

    def __init__(self, period: float = PERIOD, silence: float = SILENCE) -> None:
        self._period = period
        self._silence = silence
        self._target: Target | None = None
        self._written: Target | None = None
        self._next = float("-inf")
        self._heard = float("-inf")
        self._held = ""

    def move(self, target: Target, now: float) -> None:
        """The element was moved there; the mouse still holds it."""
        self._target = target if target != self._written else None
        self._heard, self._held = now, target.id

    def hold(self, eid: str, now: float) -> None:
        """The element is held where it is."""
        self._heard, self._held = now, eid

    def release(self) -> None:
        """The mouse was let go: what is left to write is due at once."""
        self._held = ""
        self._next = float("-inf")

    def is_held(self, eid: str, now: float) -> bool:
        """Whether somebody drags the element, so that its marker must not be put elsewhere."""
        return self._held == eid and now - self._heard < self._silence

    def wait(self, now: float) -> float | None:
        """How long until there is something to write (s); None: nothing is."""
        return None if self._target is None else max(0.0, self._next - now)

    def take(self, now: float) -> Target | None:
        """What is to be written now, None when nothing is."""
        if self._target is None or now < self._next:
            return None
        target, self._target = self._target, None
        self._written = target
        self._next = now + self._period
        return target

    def forget(self) -> None:
        """Drops what is left to write, and what was written; the world model has refused it, or has another pose."""
        self._target = self._written = None
