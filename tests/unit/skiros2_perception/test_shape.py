"""The sampled surface of a box with bores."""

from __future__ import annotations

import math

import numpy as np
import pytest

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.bore import Bore
from skiros2_motion.core.geometry import IDENTITY, Vector
from skiros2_perception.core.observation import box_distances
from skiros2_perception.core.shape import MAX_SAMPLES, box_shape

SIZE: Vector = (0.2, 0.1, 0.06)
BORE = Bore(0.03, -0.01, 0.04, 0.05, 0.003)


def test_samples_of_a_box_are_on_its_surface_with_outward_normals() -> None:
    shape = box_shape(SIZE)
    assert np.abs(box_distances(shape.points, IDENTITY, SIZE)).max() < 1e-9
    outside = box_distances(shape.points + 1e-4 * shape.normals, IDENTITY, SIZE)
    assert outside == pytest.approx(np.full(len(outside), 1e-4))


def test_samples_are_as_dense_as_asked() -> None:
    shape = box_shape(SIZE, spacing=0.004)
    area = 2 * (0.2 * 0.1 + 0.1 * 0.06 + 0.06 * 0.2)
    assert len(shape.points) == pytest.approx(area / 0.004**2, rel=0.05)


def test_large_box_is_sampled_more_coarsely() -> None:
    assert len(box_shape((5.0, 5.0, 5.0)).points) < 1.1 * MAX_SAMPLES


def test_bore_has_a_wall_a_chamfer_and_a_floor_with_normals_towards_its_axis() -> None:
    shape = box_shape(SIZE, [BORE])
    arm = shape.points[:, :2] - (BORE.x, BORE.y)
    radius, height = np.hypot(*arm.T), shape.points[:, 2]
    top, floor = SIZE[2] / 2, SIZE[2] / 2 - BORE.depth
    assert not ((radius < BORE.diameter / 2 + BORE.chamfer - 1e-6) & (height > top - 1e-9)).any()
    wall = (np.abs(radius - BORE.diameter / 2) < 1e-9) & (height < top - BORE.chamfer) & (height > floor + 1e-6)
    inward = np.einsum("ni,ni->n", shape.normals[wall, :2], arm[wall]) / radius[wall]
    assert wall.sum() > 500 and inward == pytest.approx(np.full(len(inward), -1.0))
    chamfer = (radius > BORE.diameter / 2 + 1e-6) & (radius < BORE.diameter / 2 + BORE.chamfer) & (height > 0)
    assert chamfer.any() and shape.normals[chamfer, 2] == pytest.approx(np.full(chamfer.sum(), math.sqrt(0.5)))
    bottom = (radius < BORE.diameter / 2 - 1e-3) & (np.abs(height - floor) < 1e-9)
    assert bottom.sum() == pytest.approx(math.pi * (BORE.diameter / 2) ** 2 / 0.002**2, rel=0.15)


def test_through_hole_has_no_floor() -> None:
    shape = box_shape(SIZE, [Bore(0.0, 0.0, 0.04, 0.06)])
    assert np.hypot(shape.points[:, 0], shape.points[:, 1]).min() > 0.019


def test_plain_box_has_one_start_and_a_box_with_bores_has_those_of_its_bounding_box() -> None:
    assert len(box_shape(SIZE).similar_turns()) == 1
    turns = box_shape(SIZE, [BORE]).similar_turns()
    assert len(turns) == 4 and turns[0] == (0.0, 0.0, 0.0, 1.0)
    assert len(box_shape((0.1, 0.1, 0.06), [Bore(0.0, 0.0, 0.02, 0.03)]).similar_turns()) == 8


def test_unusable_bores_are_refused_with_all_problems() -> None:
    wrong = [Bore(0.09, 0.0, 0.04, 0.05), Bore(0.0, 0.0, -1.0, 0.05), Bore(math.nan, 0.0, 0.02, 0.05)]
    with pytest.raises(WrongValue) as error:
        box_shape(SIZE, wrong, spacing=-1.0)
    text = str(error.value)
    assert "inside of the box" in text and text.count("expected a diameter") == 2 and "spacing of samples -1.0" in text


@pytest.mark.parametrize("size", [(0.0, 0.1, 0.1), (math.inf, 0.1, 0.1), (math.nan, 0.1, 0.1), (0.1, 0.1)])
def test_unusable_size_is_refused(size: tuple[float, ...]) -> None:
    with pytest.raises(WrongValue, match=r"expected three lengths, 0.001 to 100 m"):
        box_shape(size)  # type: ignore[arg-type]
