"""What shows that a part is inserted: the fingers that hold it, and the floor of the bore that withstands a push.

The depth of the tool alone shows neither. Fingers slide on a part that is jammed, at a force up to that of the
insertion. So the floor is tested with this force: if the tool moves on, it was not the floor; if it does not, the
fingers have not slid before either, and the depth of the tool is that of the part. An arm at its joint limit does not
move, but presses on nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

#: Maximum distance between fingers that hold nothing (m).
NOTHING_BETWEEN = 0.004
#: Change of the distance between the fingers at which a part is lost, and that from an open gripper (m). The wobble of
#: an insertion opens the fingers by 1 mm.
_CHANGE, _OPEN = 0.003, 0.001
#: A floor moves by less than this (m) for this time (s), under this part of the test force.
_YIELDS, _STANDS, _FORCE = 0.0005, 0.2, 0.7
#: Time constant with which the push follows the measured force (s), and the lowest stiffness of an arm (N/m).
_FOLLOWS, _SOFTEST = 0.2, 400.0
#: Speed from which on the tool counts as moving (m/s).
_CREEP = 0.001


class Judgement(StrEnum):
    """Result of an insertion, by the part."""

    INSERTED = "inserted"
    NOT_HELD = "not held"
    SLIPPED = "slipped"
    NO_FLOOR = "no floor"
    JAMMED = "jammed"


class Kind(StrEnum):
    """Kinds of evidence, from weak to strong."""

    TOOL = "tool"  # the depth of the tool
    FINGERS = "fingers"  # the distance between the fingers
    FORCE = "force"  # the floor withstands a push


def holds_something(width: float, opening: float) -> bool:
    """Whether fingers at a distance (m) hold something: they are neither closed nor open.

    :param opening: distance of the open fingers (m).
    """
    return NOTHING_BETWEEN < width < opening - _OPEN


@dataclass
class Evidence:
    """What was measured.

    :param judgement: None until the end.
    :param width_before, width_after: distance between the fingers at the start and at the end (m); None: not measured.
    :param part_width: width of the part where it is gripped (m); None: not known.
    :param opening: that of the open gripper.
    :param tool_depth: of the tool below its position at the rim (m).
    :param wanted_depth: of the part (m).
    :param floor_force: with which the floor was pushed (N); None: it was not felt.
    """

    opening: float
    wanted_depth: float
    part_width: float | None = None
    width_before: float | None = None
    width_after: float | None = None
    tool_depth: float = 0.0
    floor_force: float | None = None
    judgement: Judgement | None = None
    used: list[Kind] = field(default_factory=lambda: [Kind.TOOL])

    def see_fingers(self, width: float | None) -> None:
        """Takes a measured distance between the fingers (m)."""
        if width is None:
            return
        if self.width_before is None:
            self.width_before = width
            self.used.append(Kind.FINGERS)
        self.width_after = width

    def is_lost(self) -> bool:
        """Whether the fingers show that the part is not between them."""
        width = self.width_after
        if width is None or self.width_before is None:
            return False
        held = self.width_before if self.part_width is None else self.part_width
        return self.is_gone() or abs(width - held) > _CHANGE

    def is_gone(self) -> bool:
        """Whether the fingers show that nothing is between them: they are open, or closed."""
        return self.width_after is not None and not holds_something(self.width_after, self.opening)

    def see_floor(self, force: float) -> None:
        """Takes the force that the floor has withstood (N)."""
        self.floor_force = force
        self.used.append(Kind.FORCE)

    def values(self) -> dict[str, object]:
        """Returns the evidence as the value of a parameter: numbers in m and N; what was not measured is missing."""
        found: dict[str, object] = {
            "judgement": str(self.judgement or ""),
            "used": [str(kind) for kind in self.used],
            "tool_depth": self.tool_depth,
            "wanted_depth": self.wanted_depth,
        }
        if self.width_after is not None:
            found["held"] = not self.is_lost()
        for key in ("width_before", "width_after", "part_width", "floor_force"):
            if (value := getattr(self, key)) is not None:
                found[key] = value
        return found

    def text(self) -> str:
        """Returns the evidence for people."""
        if self.width_after is None:
            held = "the fingers are not measured"
        else:
            held = f"{1000 * self.width_after:.1f} mm between the fingers"
            if self.part_width is not None:
                held += f", {1000 * self.part_width:.1f} mm the part"
        floor = "no floor felt" if self.floor_force is None else f"the floor withstands {self.floor_force:.0f} N"
        return f"{held}; {floor}"


class FloorTest:
    """A push on what may be the floor.

    :param depth: of the tool at its start (m).
    :param now: time (s).
    :param force: of the push (N).
    :param stiffness: along the tool axis (N/m).
    :param excess: force above the measured one that does not throw a moving part at the floor (N).
    """

    def __init__(self, depth: float, now: float, force: float, stiffness: float, excess: float) -> None:
        self._depth, self._force, self._stiffness, self._excess = depth, force, stiffness, excess
        self._last = depth
        self.started = now
        self._stands_since = math.inf
        self._lead = 0.0

    def lead(self, pressed: float, depth: float, dt: float) -> float:
        """Returns how far the reference is ahead of the tool (m), so that the measured force becomes that of the test,
        also on arms with joint friction or another stiffness. While the tool moves, friction withstands it, which may
        end: then the force is at most the measured one and the excess.

        :param pressed: measured force (N).
        :param depth: of the tool (m).
        :param dt: since the last call (s).
        """
        self._lead += (self._force - pressed) / self._stiffness * dt / _FOLLOWS
        moved, self._last = depth - self._last, depth
        most = self._force / min(self._stiffness, _SOFTEST)
        if moved > _CREEP * dt:
            most = min(most, (max(pressed, 0.0) + self._excess) / self._stiffness)
        self._lead = min(max(self._lead, 0.0), most)
        return self._lead

    def has_yielded(self, depth: float) -> bool:
        """Whether the tool has moved on: it was not the floor."""
        return depth > self._depth + _YIELDS

    def has_passed(self, pressed: float, now: float) -> bool:
        """Whether the force was measured for long enough."""
        if pressed < _FORCE * self._force:
            self._stands_since = math.inf
        else:
            self._stands_since = min(self._stands_since, now)
        return now - self._stands_since >= _STANDS
