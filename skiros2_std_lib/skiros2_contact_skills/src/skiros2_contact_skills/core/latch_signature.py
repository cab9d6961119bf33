"""The force over the depth while a plug is pushed into a socket, and what it says about the latch.

A catch that is pushed aside gives a force that rises up to the depth of the latch; when it snaps in, the force drops
(the click), and the plug travels on to the floor of the socket. Friction adds to all of these forces: that of the catch
is the drop.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """What a signature says."""

    LATCHED = "latched"
    NO_CLICK = "no click"
    WRONG_FORCE = "click at a wrong force"
    WRONG_DEPTH = "click at a wrong depth"


@dataclass(frozen=True)
class Expected:
    """The latch as its socket describes it.

    :param earliest: depth before which a peak is friction at the entry (m).
    :param force: that pushes the catch aside (N).
    :param travel: from the click to the floor (m).
    :param force_tolerance: as a part of the force.
    :param travel_tolerance: m.
    """

    earliest: float
    force: float
    travel: float
    force_tolerance: float
    travel_tolerance: float

    def __str__(self) -> str:
        return f"a click at {self.force:.1f} N and {1000 * self.travel:.1f} mm before the floor"


#: A click is a drop of at least this part of the latch's force, while the plug moves on by this distance (m).
_LEAST, _MOVED = 0.4, 0.0005


class LatchSignature:
    """Records a signature.

    :ivar peak: the largest force before the click (N), or of all without one.
    :ivar peak_depth: the depth there (m).
    :ivar low: the smallest force after the peak (N).
    :ivar depth: the last depth (m).
    :ivar has_clicked: whether the force has dropped after a peak while the plug has moved on.
    """

    def __init__(self, expected: Expected) -> None:
        self.expected = expected
        self.peak = self.peak_depth = self.low = self.depth = 0.0
        self.has_clicked = False

    def add(self, depth: float, force: float) -> None:
        """Adds a measurement (m, N). The peak is kept after the click: the floor may press harder."""
        wants, self.depth = self.expected, depth
        enters = self.peak_depth < wants.earliest <= depth
        if not self.has_clicked and (enters or force >= self.peak):
            self.peak, self.peak_depth, self.low = force, depth, force
        self.low = min(self.low, force)
        has_dropped = self.drop >= _LEAST * wants.force and depth >= self.peak_depth + _MOVED
        self.has_clicked = self.has_clicked or (self.peak_depth >= wants.earliest and has_dropped)

    @property
    def drop(self) -> float:
        """The force of the catch (N): that of the peak without the friction, which stays after it."""
        return self.peak - self.low

    @property
    def verdict(self) -> Verdict:
        """What the signature says, when the plug rests."""
        wants = self.expected
        if not self.has_clicked:
            return Verdict.NO_CLICK
        if abs(self.drop - wants.force) > wants.force_tolerance * wants.force:
            return Verdict.WRONG_FORCE
        if abs(self.depth - self.peak_depth - wants.travel) > wants.travel_tolerance:
            return Verdict.WRONG_DEPTH
        return Verdict.LATCHED

    def values(self) -> list[float]:
        """Returns peak (N), its depth (m), smallest force after it (N), and last depth (m)."""
        return [self.peak, self.peak_depth, self.low, self.depth]

    def __str__(self) -> str:
        return (
            f"peak of {self.peak:.1f} N at {1000 * self.peak_depth:.1f} mm, then {self.low:.1f} N, "
            f"to {1000 * self.depth:.1f} mm"
        )
