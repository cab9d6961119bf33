"""Limits how often the poses of a drag are written."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_motion.core.geometry import Pose

#: The shortest time between two writes (s).
PERIOD = 0.1

#: A drag without feedback for this time has ended (s). Views send keep-alive messages more often.
TIMEOUT = 2.0


@dataclass(frozen=True)
class Target:
    """The pose that an element is dragged to.

    :param frame: the frame of `pose`.
    """

    id: str
    frame: str
    pose: Pose


class Dragging:
    """Keeps the latest target and says when to write it: at most once per `period`, and always the last one.

    Not thread-safe. Times are those of a monotonic clock (s).
    """

    def __init__(self, period: float = PERIOD, timeout: float = TIMEOUT) -> None:
        self._period = period
        self._timeout = timeout
        self._target: Target | None = None
        self._written: Target | None = None
        self._next = float("-inf")
        self._last_feedback = float("-inf")
        self._held = ""

    def move(self, target: Target, now: float) -> None:
        """The element was dragged to `target`; the mouse button is still down."""
        self._target = target if target != self._written else None
        self._last_feedback, self._held = now, target.id

    def hold(self, eid: str, now: float) -> None:
        """The mouse button is down and the element does not move."""
        self._last_feedback, self._held = now, eid

    def release(self) -> None:
        """The mouse button was released: a pending target is due at once."""
        self._held = ""
        self._next = float("-inf")

    def is_held(self, eid: str, now: float) -> bool:
        """Whether the element is being dragged, so that its marker must not be moved."""
        return self._held == eid and now - self._last_feedback < self._timeout

    def wait(self, now: float) -> float | None:
        """Returns the time until a target is due (s); None without a pending target."""
        return None if self._target is None else max(0.0, self._next - now)

    def take(self, now: float) -> Target | None:
        """Returns the target that is due and marks it as written; None if none is due."""
        if self._target is None or now < self._next:
            return None
        target, self._target = self._target, None
        self._written = target
        self._next = now + self._period
        return target

    def forget(self) -> None:
        """Discards the pending and the last written target: the world model has refused it."""
        self._target = self._written = None
