"""Judges by the simulated world's true poses whether a product was put down properly. Needs no ROS.

All that is compared is phrased so that a NaN never holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_bags.core.checking import Finding
from skiros2_std_reasoners.core.geometry import Pose, Quaternion, Vector, composed, half_extents, inverted, rotated

#: How far the product's underside may be above the tray's top side, or its edges over the tray's (m).
GAP = 0.01
#: How much it may lean (rad).
TILT = math.radians(5.0)
#: What counts as at rest (m/s, rad/s).
SPEED, SPIN = 0.005, 0.05


@dataclass(frozen=True)
class Body:
    """A box.

    :param name: what people call it.
    :param pose: of its middle, in the map.
    :param size: of its edges along its own axes (m).
    """

    name: str
    pose: Pose
    size: Vector


def judged(
    product: Body, tray: Body, velocity: Iterable[float], spin: Iterable[float], touched_by: Iterable[str]
) -> list[Finding]:
    """Whether a product lies in a tray, stands upright on it, is at rest, and is held by nothing.

    :param velocity, spin: of the product (m/s, rad/s).
    :param touched_by: the links of robots that touch it.
    """
    x, y, z = composed(inverted(tray.pose), product.pose).position
    reach = half_extents(composed(inverted(tray.pose), product.pose).orientation, product.size)
    within = all(abs(at) + half <= edge / 2 + GAP for at, half, edge in zip((x, y), reach, tray.size, strict=False))
    lean = min(_leaning(product.pose.orientation, axis) for axis in _upright_axes(product.size))
    gap = z - reach[2] - tray.size[2] / 2
    # On a tray that is a box it stands on top; in one with a rim it stands on the floor, somewhat lower.
    on_it = -tray.size[2] - GAP <= gap <= GAP
    speed, turning = math.hypot(*velocity), math.hypot(*spin)
    holders = sorted(touched_by)
    return [
        Finding(within, f"{product.name} is within {tray.name}, {math.hypot(x, y) * 1e3:.0f} mm from its middle"),
        Finding(on_it, f"it stands on it: its underside is {gap * 1e3:z.0f} mm above the tray's top"),
        Finding(lean <= TILT, f"it is upright: it leans by {math.degrees(lean):.1f} degrees"),
        Finding(speed <= SPEED and turning <= SPIN, f"it is at rest: it moves with {speed * 1e3:.1f} mm/s"),
        Finding(not holders, f"it is held by {', '.join(holders)}" if holders else "no robot touches it"),
    ]


def _upright_axes(size: Vector) -> list[Vector]:
    """The axes of a box that may be upright: its z, and others with edges as long; nobody can tell these apart."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [axis for axis, edge in zip(axes, size, strict=True) if math.isclose(edge, size[2], rel_tol=0.01)]


def _leaning(orientation: Quaternion, axis: Vector) -> float:
    """The angle between an axis of a box and the vertical (rad); a box has no top."""
    upward = abs(rotated(orientation, axis)[2])
    return math.acos(min(1.0, upward)) if math.isfinite(upward) else math.nan
