"""A box with bores, made of boxes."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.bore import Bore
from skiros2_sim.core.bored_box import BoxShape, bored_box

SIZE = (0.3, 0.12, 0.06)
BORES = [Bore(x, 0.0, 0.0402, 0.05) for x in (-0.105, -0.035, 0.035, 0.105)]


def contains(shapes: list[BoxShape], points: np.ndarray) -> np.ndarray:
    """Whether each point is in one of the boxes."""
    found = np.zeros(len(points), dtype=bool)
    for shape in shapes:
        local = Rotation.from_quat(shape.orientation).inv().apply(points - np.array(shape.position))
        found |= (np.abs(local) <= np.array(shape.half_edges) + 1e-9).all(axis=1)
    return found


def random_points(count: int = 20_000) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.5, 0.5, (count, 3)) * np.array(SIZE)


def test_box_without_bores_is_one_box() -> None:
    assert bored_box(SIZE, []) == [BoxShape((0.15, 0.06, 0.03), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))]


def test_bores_are_free_and_the_rest_is_filled() -> None:
    points = random_points()
    full = contains(bored_box(SIZE, BORES), points)
    distance = np.min([np.hypot(points[:, 0] - bore.x, points[:, 1] - bore.y) for bore in BORES], axis=0)
    above_floor = points[:, 2] > SIZE[2] / 2 - 0.05
    radius = 0.0201
    assert not full[(distance < radius - 1e-6) & above_floor].any()
    corner = radius / math.cos(math.pi / 16)  # the sides are flat
    assert full[(distance > corner + 1e-6) | ~above_floor].all()


def test_chamfer_widens_the_upper_edge() -> None:
    chamfer = 0.003
    shapes = bored_box(SIZE, [Bore(0.0, 0.0, 0.04, 0.05, chamfer)])
    heights = np.linspace(0.0, 0.006, 25)[1:-1]
    for height in heights:
        free = 0.02 + max(0.0, chamfer - height)
        at = np.array([[free - 1e-4, 0.0, 0.03 - height], [free + 2e-4, 0.0, 0.03 - height]])
        assert contains(shapes, at).tolist() == [False, True]


def corners(shapes: list[BoxShape]) -> np.ndarray:
    """The corners of all boxes: n x 3."""
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    turned = [Rotation.from_quat(shape.orientation).apply(signs * shape.half_edges) for shape in shapes]
    return np.vstack([around + shape.position for around, shape in zip(turned, shapes, strict=True)])


@settings(deadline=None)
@given(
    x=st.floats(-0.1, 0.1),
    y=st.floats(-0.03, 0.03),
    radius=st.floats(0.001, 0.05),
    depth=st.floats(0.001, 0.06),
    chamfer=st.one_of(st.just(0.0), st.floats(0.0001, 0.03)),
)
def test_no_box_sticks_out_of_the_block(x, y, radius, depth, chamfer) -> None:
    try:
        shapes = bored_box(SIZE, [Bore(x, y, 2 * radius, depth, chamfer)])
    except WrongValue:
        return
    assert np.abs(corners(shapes)).max(axis=0) == pytest.approx(np.array(SIZE) / 2, abs=1e-9)


@pytest.mark.parametrize("chamfer", [0.0, 0.002])
def test_bore_may_touch_the_faces_of_its_block_but_for_a_thin_wall(chamfer) -> None:
    shapes = bored_box((0.2, 0.07, 0.01), [Bore(-0.065, 0.0, 0.052, 0.01, chamfer)])
    assert np.abs(corners(shapes)).max(axis=0) == pytest.approx((0.1, 0.035, 0.005), abs=1e-9)
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (20_000, 3)) * np.array((0.2, 0.07, 0.01))
    distance = np.hypot(points[:, 0] + 0.065, points[:, 1])
    widened = 0.026 + np.maximum(0.0, chamfer - (0.005 - points[:, 2]))
    full = contains(shapes, points)
    assert not full[distance < widened - 1e-6].any()
    assert full[distance > widened / math.cos(math.pi / 16) + 1e-6].all()


def test_through_hole_has_no_floor() -> None:
    shapes = bored_box(SIZE, [Bore(0.0, 0.0, 0.04, SIZE[2])])
    axis = np.array([[0.0, 0.0, z] for z in np.linspace(-0.029, 0.029, 20)])
    assert not contains(shapes, axis).any()


@pytest.mark.parametrize(
    ("bores", "reason"),
    [
        ([Bore(0.0, 0.0, 0.2, 0.05)], "diameter 0.2 m: expected up to 0.1000 m"),
        ([Bore(0.0, 0.0, 0.05, 0.05), Bore(0.05, 0.0, 0.05, 0.05)], r"bore at \(0, 0\).*bore at \(0.05, 0\)"),
        ([Bore(0.2, 0.0, 0.01, 0.05)], r"bore at \(0.2, 0\)"),
        ([Bore(0.0, 0.0, math.nan, 0.05)], "above 0"),
        ([Bore(0.0, 0.0, 0.04, 0.05, 0.06)], "chamfer"),
    ],
)
def test_impossible_bore_is_refused_with_its_position(bores, reason) -> None:
    with pytest.raises(WrongValue, match=reason):
        bored_box(SIZE, bores)
