"""A round bore of a box, as the world model has it (`skiros:Bore`), and its latch."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Latch:
    """A spring-loaded catch in a bore, which holds a plug.

    :param depth: of the lower end of the plug, at which the catch snaps in (m).
    :param force: that pushes the catch aside, at this depth (N).
    :param retention: force that pulls a latched plug out (N).
    """

    depth: float
    force: float
    retention: float


@dataclass(frozen=True)
class Bore:
    """A bore from the top face of a box downwards.

    :param x: position of its axis in the frame of the box (m).
    :param y: same.
    :param diameter: of the largest cylinder that fits (m).
    :param depth: m; at least the height of the box for a through hole.
    :param chamfer: width and height of the bevel of 45 degrees at its upper edge (m).
    :param latch: None for a bore without one.
    """

    x: float
    y: float
    diameter: float
    depth: float
    chamfer: float = 0.0
    latch: Latch | None = None
