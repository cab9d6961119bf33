"""Pulls a part back after a failed motion in contact, so that it stays neither jammed nor on a rim."""

from __future__ import annotations

#: The part is pulled out to this height above the surface (m), with this speed (m/s), within some more time (s).
_CLEAR, _SPEED, _MORE_TIME = 0.005, 0.05, 3.0
#: Tolerance of the height, and maximum lead of the reference beyond it (m).
_NEAR, _BEYOND = 0.0005, 0.005


class PullOut:
    """One retreat along the tool axis.

    :param reason: of the failure.
    :param code: of the failure.
    :param word: what is done to the part: it is `pulled out`, `lifted`.
    :param depth: of the tool below the surface at the start (m).
    :param now: time (s).
    :param pull: maximum lead of the reference over the tool (m): force over stiffness.
    """

    def __init__(self, reason: str, code: int, word: str, depth: float, now: float, pull: float) -> None:
        self.code = code
        self._reason, self._word = reason, word
        self._target, self._pull = depth, pull
        self._until = now + (depth + _CLEAR) / _SPEED + _MORE_TIME

    def result(self, depth: float, now: float) -> str:
        """Returns the reason of the failure with what became of the part; "" while it is pulled."""
        if depth < -_CLEAR + _NEAR:
            return f"{self._reason}; it is {self._word}"
        if now > self._until:
            return f"{self._reason}; it cannot be {self._word} and stays {1000 * depth:.1f} mm deep"
        return ""

    def ahead(self, depth: float, dt: float) -> float:
        """Returns how far the reference is ahead of the tool along its axis, below 0 (m).

        :param dt: since the last call (s).
        """
        self._target = max(self._target - _SPEED * dt, depth - self._pull, -_CLEAR - _BEYOND)
        return self._target - depth
