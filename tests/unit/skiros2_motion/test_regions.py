"""Regions as repulsive planes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_motion.core.geometry import IDENTITY, Pose, from_euler
from skiros2_motion.core.regions import MARGIN, WALL_FORCE, Region, kept_out, repelled

BOX = Region("box", Pose((0.5, 0.0, 0.0), IDENTITY.orientation), (0.2, 0.4, 0.6))
ROUND = Region("cylinder", Pose((0.5, 0.0, 0.0), IDENTITY.orientation), (0.2, 0.2, 0.6), True)
FLOOR = Region("floor", Pose((0.0, 0.0, 0.1), IDENTITY.orientation))
WALL = Region("wall", Pose((0.6, 0.0, 0.0), from_euler(0.0, -math.pi / 2.0, 0.0)))  # what is beyond x = 0.6


@pytest.mark.parametrize(
    ("region", "point", "distance", "normal"),
    [
        (BOX, (0.3, 0.1, 0.1), 0.1, (-1.0, 0.0, 0.0)),
        (BOX, (0.64, 0.23, 0.1), 0.05, (0.8, 0.6, 0.0)),
        (BOX, (0.42, 0.0, 0.0), -0.02, (-1.0, 0.0, 0.0)),
        (ROUND, (0.5 + 0.18 * 0.6, 0.18 * 0.8, 0.1), 0.08, (0.6, 0.8, 0.0)),
        (ROUND, (0.5, 0.0, 0.35), 0.05, (0.0, 0.0, 1.0)),
        (ROUND, (0.5, 0.01, 0.0), -0.09, (0.0, 1.0, 0.0)),
        (FLOOR, (3.0, 2.0, 0.3), 0.2, (0.0, 0.0, 1.0)),
        (WALL, (0.5, 1.0, 1.0), 0.1, (-1.0, 0.0, 0.0)),
    ],
)
def test_plane_of_a_region_is_at_its_nearest_point(
    region: Region, point: tuple[float, ...], distance: float, normal: tuple[float, ...]
) -> None:
    found, out = region.plane(point)
    assert found == pytest.approx(distance)
    assert out == pytest.approx(normal, abs=1e-9)
    assert region.has_inside(point) == (distance < 0.0)


def test_force_into_a_region_is_taken_away_at_its_plane_and_the_rest_stays() -> None:
    force = repelled(np.array([40.0, 7.0, 0.0]), (0.6, 0.0, 0.0), np.zeros(3), [WALL])
    assert force.tolist() == pytest.approx([-WALL_FORCE, 7.0, 0.0], abs=1e-9)
    far = np.array([40.0, 7.0, 0.0])
    assert repelled(far, (0.6 - MARGIN, 0.0, 0.0), np.array([0.5, 0.0, 0.0]), [WALL]) is far
    away = repelled(np.array([-40.0, 0.0, 0.0]), (0.6, 0.0, 0.0), np.zeros(3), [WALL])
    assert away[0] == pytest.approx(-40.0 - WALL_FORCE), "a retreat is not hindered"


def test_reference_is_not_beyond_the_plane() -> None:
    tool, beyond = Pose((0.5, 0.0, 0.0), IDENTITY.orientation), Pose((0.9, 0.2, 0.0), IDENTITY.orientation)
    assert kept_out(beyond, tool, (600.0,) * 3, [WALL]).position == pytest.approx((0.6 - MARGIN, 0.2, 0.0))
    near = Pose((0.59, 0.0, 0.0), IDENTITY.orientation)
    pushed = kept_out(beyond, near, (600.0,) * 3, [WALL])
    assert 600.0 * (0.59 - pushed.position[0]) == pytest.approx(4000.0 * 0.02)
    assert kept_out(tool, tool, (600.0,) * 3, [WALL, FLOOR]).position[2] > 0.1, "that of each region"
