"""Images, camera matrices and point clouds from messages, checked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from skiros2_common.core.errors import WrongValue

#: Encodings of depth images: type, and metres of one unit.
_DEPTH = {"32FC1": ("f4", 1.0), "16UC1": ("u2", 0.001), "mono16": ("u2", 0.001)}
_COLOUR = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0)}


def depth_of(message: Image) -> npt.NDArray[np.float64]:
    """Returns the depth of an image: height x width (m); NaN where nothing was measured.

    :raises WrongValue: encoding or size is unusable.
    """
    if message.encoding not in _DEPTH:
        raise WrongValue(f"depth image with encoding {message.encoding!r}: expected {', '.join(_DEPTH)}")
    kind, unit = _DEPTH[message.encoding]
    pixels = _pixels(message, np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<"), 1)[:, :, 0]
    depth = pixels.astype(float) * unit
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.nan)


def colours_of(message: Image) -> npt.NDArray[np.uint8]:
    """Returns the colours of an image: height x width x 3, red, green, blue.

    :raises WrongValue: encoding or size is unusable.
    """
    if message.encoding not in _COLOUR:
        raise WrongValue(f"colour image with encoding {message.encoding!r}: expected {', '.join(_COLOUR)}")
    return np.ascontiguousarray(_pixels(message, np.dtype("u1"), 3)[:, :, list(_COLOUR[message.encoding])])


def _pixels(message: Image, kind: np.dtype[Any], channels: int) -> npt.NDArray[Any]:
    row = message.width * channels * kind.itemsize
    if message.step < row or len(message.data) != message.step * message.height or not row:
        raise WrongValue(
            f"image of {message.width} x {message.height} pixels in {message.header.frame_id!r}: {len(message.data)}"
            f" bytes in steps of {message.step}: expected at least {row} bytes a row"
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)[:, :row]
    return np.ascontiguousarray(rows).view(kind).reshape(message.height, message.width, channels)


def lens_of(info: CameraInfo, image: Image) -> tuple[tuple[float, float], tuple[float, float]]:
    """Returns focal lengths and principal point of the rectified image (pixels).

    :raises WrongValue: it does not belong to the image, or is not calibrated; the text lists all problems.
    """
    p = info.P
    problems = []
    if (info.width, info.height) != (image.width, image.height):
        problems.append(f"{info.width} x {info.height} pixels: expected {image.width} x {image.height}")
    if info.header.frame_id != image.header.frame_id:
        problems.append(f"frame {info.header.frame_id!r}: expected {image.header.frame_id!r}")
    if not all(map(math.isfinite, p)) or p[0] <= 0 or p[5] <= 0:
        problems.append(f"projection matrix {tuple(p)}: expected a calibrated camera")
    if problems:
        raise WrongValue(f"camera_info: {'; '.join(problems)}")
    return (p[0], p[5]), (p[2], p[6])


def points_of(message: PointCloud2) -> npt.NDArray[np.float64]:
    """Returns the points of an organised cloud: height x width x 3 (m).

    :raises WrongValue: fields or size are unusable; the text lists all problems.
    """
    offsets = {field.name: field.offset for field in message.fields if field.datatype == PointField.FLOAT32}
    missing = sorted({"x", "y", "z"} - set(offsets))
    problems = [f"no field {name} of type FLOAT32" for name in missing]
    if message.height < 2:
        problems.append(f"{message.height} row of points: expected an organised cloud")
    if message.row_step < message.point_step * message.width or len(message.data) != message.row_step * message.height:
        problems.append(f"{len(message.data)} bytes: expected {message.height} rows of {message.row_step}")
    if problems:
        raise WrongValue(f"point cloud in {message.header.frame_id!r}: {'; '.join(problems)}")
    kind = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": [(">" if message.is_bigendian else "<") + "f4"] * 3,
            "offsets": [offsets[axis] for axis in "xyz"],
            "itemsize": message.point_step,
        }
    )
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.row_step)
    cells = np.ascontiguousarray(rows[:, : message.point_step * message.width]).view(kind)
    return np.stack([cells[axis].astype(float) for axis in "xyz"], axis=-1)
