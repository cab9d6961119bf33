"""Checks the placement of a product by true poses of the simulated world. Needs no ROS.

All comparisons are false for NaN.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_bags.core.run import Finding
from skiros2_std_reasoners.core.geometry import Pose, Quaternion, Vector, composed, half_extents, inverted, rotated

#: Maximum gap between product and tray, and maximum overhang of its edges (m).
GAP = 0.01
#: Maximum tilt (rad).
TILT = math.radians(5.0)
#: Maximum speed at rest (m/s, rad/s).
SPEED, SPIN = 0.005, 0.05


@dataclass(frozen=True)
class Body:
    """A box.

    :param name: for people.
    :param pose: of its centre, in the map.
    :param size: edge lengths along its own axes (m).
    """

    name: str
    pose: Pose
    size: Vector


def check_placement(
    product: Body, tray: Body, velocity: Iterable[float], spin: Iterable[float], touched_by: Iterable[str]
) -> list[Finding]:
    """Checks that a product is in a tray, upright, at rest, and not held.

    :param velocity, spin: of the product (m/s, rad/s).
    :param touched_by: links of robots in contact with it.
    """
    x, y, z = composed(inverted(tray.pose), product.pose).position
    reach = half_extents(composed(inverted(tray.pose), product.pose).orientation, product.size)
    within = all(abs(at) + half <= edge / 2 + GAP for at, half, edge in zip((x, y), reach, tray.size, strict=False))
    lean = min(_tilt(product.pose.orientation, axis) for axis in _upright_axes(product.size))
    gap = z - reach[2] - tray.size[2] / 2
    # on top of a solid tray; on the floor of a tray with a rim, which is lower
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
    """Returns the axes of a box that may be vertical: z, and axes with edges of the same length."""
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [axis for axis, edge in zip(axes, size, strict=True) if math.isclose(edge, size[2], rel_tol=0.01)]


def _tilt(orientation: Quaternion, axis: Vector) -> float:
    """Returns the angle between an axis of a box and the vertical (rad), ignoring its sign."""
    upward = abs(rotated(orientation, axis)[2])
    return math.acos(min(1.0, upward)) if math.isfinite(upward) else math.nan
