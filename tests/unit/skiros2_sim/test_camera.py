"""Images of a small world without robots: a table with cubes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_motion.core.geometry import IDENTITY, Pose, rotated
from skiros2_sim.core.camera import Lens, looking_at, picture_from, picture_of, save_png
from skiros2_sim.core.scene_spec import BodySpec, CameraSpec, SceneSpec
from skiros2_sim.core.world import World

TABLE = BodySpec("demo:Workstation-1", pose=Pose((0.0, 0.0, 0.25), IDENTITY.orientation), size=(1.0, 1.0, 0.5))
RED = BodySpec(
    "skiros:Product-2",
    pose=Pose((0.1, 0.2, 0.525), IDENTITY.orientation),
    size=(0.05, 0.05, 0.05),
    movable=True,
    colour=(1.0, 0.0, 0.0, 1.0),
)
ABOVE = CameraSpec("skiros:DepthCamera-3", "above", pose=looking_at((0.0, 0.0, 1.5), (0.0, 0.0, 0.0)))


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World(SceneSpec(bodies=(TABLE, RED), cameras=(ABOVE,))) as world:
        yield world


def test_depth_is_the_distance_along_the_axis_in_metres(world: World) -> None:
    picture = picture_of(world, ABOVE.id)
    assert picture.depth.shape == (240, 320)
    assert picture.depth.dtype == np.float32
    table, cube = picture.pixels_of(TABLE.id), picture.pixels_of(RED.id)
    assert picture.depth[table] == pytest.approx(1.0, abs=1e-3)
    assert picture.depth[cube].min() == pytest.approx(0.95, abs=1e-3)


def test_pixels_have_element_and_colour(world: World) -> None:
    picture = picture_of(world, ABOVE.id)
    assert {TABLE.id, RED.id} <= set(picture.ids)
    cube = picture.rgb[picture.pixels_of(RED.id)]
    assert len(cube) > 50
    assert (cube[:, 0] > 60).all()
    assert (cube[:, 1:] < 40).all()
    assert not picture.pixels_of("skiros:Product-99").any()


def test_points_lie_on_the_visible_surface(world: World) -> None:
    picture = picture_of(world, ABOVE.id)
    points = picture.points(picture.pixels_of(RED.id))
    in_map = np.array([rotated(picture.pose.orientation, tuple(p)) for p in points]) + picture.pose.position
    beyond = np.abs(in_map - RED.pose.position) - 0.025
    assert beyond.max() < 1e-3
    assert np.abs(beyond.max(axis=1)).max() < 1e-3


def test_camera_matrix_projects_points_to_pixels(world: World) -> None:
    picture = picture_of(world, ABOVE.id)
    pixels = picture.pixels_of(RED.id)
    points = picture.points(pixels)
    projected = points @ np.array(picture.lens.matrix).reshape(3, 3).T
    columns_rows = projected[:, :2] / projected[:, 2:]
    rows, columns = np.nonzero(pixels)
    assert columns_rows == pytest.approx(np.stack((columns, rows), axis=1), abs=1e-6)


def test_background_has_no_depth_and_no_element(world: World) -> None:
    picture = picture_from(world, looking_at((0.0, 0.0, 2.0), (1.0, 0.0, 3.0)), Lens(32, 24))
    assert np.isnan(picture.depth).all()
    assert (picture.segments < 0).all()
    assert picture.ids == ()
    assert len(picture.points(np.ones((24, 32), bool))) == 0


def test_rendering_is_deterministic(world: World) -> None:
    once, again = picture_of(world, ABOVE.id), picture_of(world, ABOVE.id)
    assert np.array_equal(once.rgb, again.rgb)
    assert np.array_equal(once.depth, again.depth, equal_nan=True)


def test_free_camera_looks_at_its_target(world: World) -> None:
    pose = looking_at((1.0, -1.0, 1.5), RED.pose.position)
    picture = picture_from(world, pose, Lens(101, 101, math.radians(40)), shadow=True)
    rows, columns = np.nonzero(picture.pixels_of(RED.id))
    assert rows.mean() == pytest.approx(50, abs=2)
    assert columns.mean() == pytest.approx(50, abs=2)
    up = rotated(pose.orientation, (0.0, -1.0, 0.0))
    assert up[2] > 0


@pytest.mark.parametrize("target", [(0.0, 0.0, 1.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_invalid_view_is_rejected(target: tuple[float, float, float]) -> None:
    with pytest.raises(WrongValue, match="the points are equal"):
        looking_at((0.0, 0.0, 1.0), target)


@pytest.mark.parametrize(
    ("width", "height", "angle"), [(0, 10, 1.0), (10, -1, 1.0), (10**6, 10, 1.0), (10, 10, 0.0), (10, 10, math.nan)]
)
def test_invalid_lens_is_rejected(width: int, height: int, angle: float) -> None:
    with pytest.raises(WrongValue, match="expected"):
        Lens(width, height, angle)


def test_unknown_camera_is_rejected(world: World) -> None:
    with pytest.raises(UnknownName, match="DepthCamera-9"):
        picture_of(world, "skiros:DepthCamera-9")


def test_picture_is_saved_as_png(world: World, tmp_path: Path) -> None:
    file = tmp_path / "pictures" / "above.png"
    picture = picture_of(world, ABOVE.id)
    save_png(picture, file)
    assert np.array_equal(np.asarray(Image.open(file)), picture.rgb)
