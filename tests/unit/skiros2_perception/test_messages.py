"""Depth images, camera matrices and point clouds from messages."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import IDENTITY
from skiros2_perception.core.view import view_of_points
from skiros2_perception.ros.messages import colours_of, depth_of, lens_of, points_of

HEADER = Header(frame_id="camera")


def image(pixels: np.ndarray, encoding: str, padding: int = 0, **more: int) -> Image:
    """An image message with `padding` bytes after each row."""
    height, width = pixels.shape[:2]
    rows = np.pad(pixels.reshape(height, -1).view(np.uint8), ((0, 0), (0, padding)))
    return Image(HEADER, height, width, encoding, more.get("is_bigendian", 0), rows.shape[1], rows.tobytes())


def info(**more: object) -> CameraInfo:
    p = (100.0, 0.0, 15.0, 0.0, 0.0, 101.0, 10.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    return CameraInfo(**({"header": HEADER, "width": 30, "height": 20, "P": p} | more))


def cloud(points: np.ndarray, point_step: int = 16, **more: object) -> PointCloud2:
    """A cloud message with gaps between the points."""
    height, width = points.shape[:2]
    data = np.zeros((height, width, point_step), np.uint8)
    data[:, :, :12] = points.astype("<f4").view(np.uint8).reshape(height, width, 12)
    fields = [PointField(name, 4 * n, PointField.FLOAT32, 1) for n, name in enumerate("xyz")]
    usual = {"fields": fields, "data": data.tobytes(), "row_step": width * point_step}
    return PointCloud2(header=HEADER, height=height, width=width, point_step=point_step, **(usual | more))


def plane(height: int = 20, width: int = 30) -> np.ndarray:
    """The points of a tilted plane in a camera with fx 100, fy 101, cx 15, cy 10."""
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    z = 1.0 + 0.01 * columns
    return np.stack(((columns - 15) / 100 * z, (rows - 10) / 101 * z, z), axis=-1)


def test_depth_in_metres_is_read_row_by_row() -> None:
    pixels = np.arange(600, dtype="<f4").reshape(20, 30) / 100
    read = depth_of(image(pixels, "32FC1", padding=8))
    assert np.isnan(read[0, 0]) and read[1, 2] == pytest.approx(0.32) and read.shape == (20, 30)


def test_depth_in_millimetres_is_read_in_either_byte_order() -> None:
    pixels = np.full((20, 30), 1234)
    assert depth_of(image(pixels.astype("<u2"), "16UC1"))[3, 4] == pytest.approx(1.234)
    assert depth_of(image(pixels.astype(">u2"), "16UC1", is_bigendian=1))[3, 4] == pytest.approx(1.234)


def test_pixels_that_are_zero_negative_or_infinite_have_no_depth() -> None:
    pixels = np.tile(np.array((0.0, -1.0, math.inf, math.nan, 1.0), "<f4"), (20, 1))
    assert np.isfinite(depth_of(image(pixels, "32FC1"))[0]).tolist() == [False, False, False, False, True]


def test_colours_are_read_in_either_order() -> None:
    pixels = np.tile(np.array((1, 2, 3), np.uint8), (20, 30, 1))
    assert colours_of(image(pixels, "rgb8"))[0, 0].tolist() == [1, 2, 3]
    assert colours_of(image(pixels, "bgr8"))[0, 0].tolist() == [3, 2, 1]


def test_unknown_encodings_are_refused_with_the_known_ones() -> None:
    pixels = np.zeros((20, 30), "<f4")
    with pytest.raises(WrongValue, match="'8UC1': expected 32FC1, 16UC1, mono16"):
        depth_of(image(pixels, "8UC1"))
    with pytest.raises(WrongValue, match="'yuv422': expected rgb8, bgr8"):
        colours_of(image(pixels, "yuv422"))


def test_incomplete_image_is_refused() -> None:
    message = image(np.ones((20, 30), "<f4"), "32FC1")
    message.data = message.data[:-1]
    with pytest.raises(WrongValue, match="2399 bytes in steps of 120"):
        depth_of(message)


def test_camera_matrix_of_the_rectified_image_is_used() -> None:
    assert lens_of(info(), image(np.ones((20, 30), "<f4"), "32FC1")) == ((100.0, 101.0), (15.0, 10.0))


def test_camera_info_of_another_image_is_refused_with_all_problems() -> None:
    wrong = info(width=640, header=Header(frame_id="other"), P=(0.0,) * 12)
    with pytest.raises(WrongValue) as error:
        lens_of(wrong, image(np.ones((20, 30), "<f4"), "32FC1"))
    expected = ("640 x 20 pixels: expected 30 x 20", "frame 'other': expected 'camera'", "expected a calibrated camera")
    assert all(part in str(error.value) for part in expected)


def test_organised_cloud_gives_the_camera_matrix_and_the_depth() -> None:
    points = plane()
    points[3, 4] = math.nan
    view = view_of_points(points_of(cloud(points)), IDENTITY, "map", 1.0)
    assert view.focal == pytest.approx((100.0, 101.0), rel=1e-4)
    assert view.centre == pytest.approx((15.0, 10.0), abs=1e-2)
    assert np.isnan(view.depth[3, 4]) and view.depth[5, 6] == pytest.approx(1.06)


def test_cloud_that_is_not_organised_is_refused_with_all_problems() -> None:
    message = cloud(plane(1, 600), fields=[PointField("x", 0, PointField.FLOAT32, 1)], row_step=5)
    with pytest.raises(WrongValue) as error:
        points_of(message)
    for part in ("no field y of type FLOAT32", "1 row of points: expected an organised cloud", "bytes: expected"):
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.full((20, 30, 3), np.nan), "0 points before the camera"),
        (np.empty((0, 0, 3)), "expected an organised cloud"),
        (plane()[:, :, [2, 0, 1]], "expected .* z forward|expected the camera's optical frame"),
        (np.random.default_rng(0).uniform(0.1, 1.0, (20, 30, 3)), "expected the camera's optical frame"),
    ],
)
def test_cloud_in_another_frame_or_without_points_is_refused(points: np.ndarray, reason: str) -> None:
    with pytest.raises(WrongValue, match=reason):
        view_of_points(points, IDENTITY, "map", 0.0)
