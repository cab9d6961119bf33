"""A depth image with the camera's calibration and pose, and the surface points measured in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose
from skiros2_perception.core.transforms import Array, matrix_of, transformed, untransformed

#: Maximum length of an image's edge (pixels).
_MAX_PIXELS = 8192
#: Number of neighbours of a point for its normal.
_NEIGHBOURS = 24


@dataclass(frozen=True)
class Sensor:
    """Errors of a depth camera.

    :param noise: standard deviation of a pixel's depth (m).
    :param position: standard deviation of the camera's position, along each axis: calibration and kinematics of the arm
        (m).
    :param angle: same, of its orientation, about each axis (rad).
    :param nearest: shortest distance that is used (m); a gripper in the image is closer.
    :param farthest: longest distance that is used (m).
    :raises WrongValue: a number is out of range; the text lists all problems.
    """

    noise: float = 0.001
    position: float = 0.0002
    angle: float = 0.0003
    nearest: float = 0.15
    farthest: float = 2.0

    def __post_init__(self) -> None:
        limits = {"noise": (1e-5, 0.1), "position": (0.0, 0.1), "angle": (0.0, 0.2), "nearest": (0.0, 10.0)}
        limits["farthest"] = (self.nearest, 100.0)
        problems = [
            f"{name} {getattr(self, name)}: expected {low:g} to {high:g}"
            for name, (low, high) in limits.items()
            if not low <= getattr(self, name) <= high
        ]
        if problems:
            raise WrongValue(f"depth camera: {'; '.join(problems)}")


@dataclass(frozen=True, eq=False)
class View:
    """A depth image, taken by a pinhole camera without distortion.

    :param depth: height x width: distance along the optical axis (m); NaN where nothing was measured.
    :param focal: focal lengths fx, fy (pixels).
    :param centre: principal point cx, cy (pixels).
    :param pose: of the optical frame (x right, y down, z forward) in the reference frame, whose z axis points up.
    :param frame: name of the reference frame.
    :param stamp: time of the image (s).
    :param rgb: height x width x 3, 0 to 255, of the same pixels; None without colours.
    :raises WrongValue: the image cannot be used; the text lists all problems.
    """

    depth: Array
    focal: tuple[float, float]
    centre: tuple[float, float]
    pose: Pose
    frame: str = "map"
    stamp: float = 0.0
    rgb: npt.NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        problems = [*_image_problems(self.depth, self.rgb)]
        numbers = (*self.focal, *self.centre)
        if not all(map(math.isfinite, numbers)) or not all(0 < f < 1e5 for f in self.focal):
            problems.append(f"camera matrix with fx, fy {self.focal} and cx, cy {self.centre}: expected finite numbers")
        q = self.pose.orientation
        if not all(map(math.isfinite, (*self.pose.position, *q))) or not 0.99 < math.hypot(*q) < 1.01:
            problems.append(f"pose of the camera {tuple(self.pose)}: expected finite numbers and a unit quaternion")
        if not math.isfinite(self.stamp):
            problems.append(f"time {self.stamp}: expected a finite number")
        if problems:
            raise WrongValue(f"depth image in {self.frame!r}: {'; '.join(problems)}")

    def points(self, mask: npt.NDArray[np.bool_]) -> Array:
        """Returns the points of pixels with a depth: n x 3, in the reference frame, row by row."""
        rows, columns = np.nonzero(mask & np.isfinite(self.depth))
        z = self.depth[rows, columns].astype(float)
        (fx, fy), (cx, cy) = self.focal, self.centre
        return transformed(self.pose, np.stack(((columns - cx) / fx * z, (rows - cy) / fy * z, z), axis=1))

    def measured(self, sensor: Sensor) -> npt.NDArray[np.bool_]:
        """Returns the mask of pixels with a depth within the range of the sensor: height x width."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.depth >= sensor.nearest) & (self.depth <= sensor.farthest))

    def projected(self, points: Array) -> tuple[Array, npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Projects points (n x 3, in the reference frame) into the image.

        :returns: depths (n), pixels as row and column (n x 2), and which points are in the image (n); the pixels of the
            others are 0.
        """
        local = untransformed(self.pose, points)
        z = local[:, 2]
        ahead = z > 1e-3
        safe = np.where(ahead, z, 1.0)
        columns = np.rint(local[:, 0] / safe * self.focal[0] + self.centre[0])
        rows = np.rint(local[:, 1] / safe * self.focal[1] + self.centre[1])
        height, width = self.depth.shape
        inside = ahead & (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        pixels = np.where(inside[:, None], np.stack((rows, columns), axis=1), 0.0).astype(np.int64)
        return z, pixels, inside


def _image_problems(depth: Array, rgb: npt.NDArray[np.uint8] | None) -> list[str]:
    shape = np.shape(depth)
    if len(shape) != 2 or not all(8 <= edge <= _MAX_PIXELS for edge in shape):
        return [f"an image of shape {shape}: expected height x width, 8 to {_MAX_PIXELS} pixels each"]
    problems = []
    if not np.isfinite(depth).any():
        problems.append("no pixel has a depth")
    elif np.nanmin(np.where(np.isfinite(depth), depth, np.nan)) < 0:
        problems.append("a depth is negative")
    if rgb is not None and np.shape(rgb) != (*shape, 3):
        problems.append(f"colours of shape {np.shape(rgb)}: expected {(*shape, 3)}")
    return problems


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a surface, in the reference frame of their view.

    :param points: n x 3 (m).
    :param normals: n x 3, unit vectors towards the camera.
    :param deviations: n: standard deviation of each point along its normal (m).
    :param colours: n x 3, 0 to 255; None without colours.
    """

    points: Array
    normals: Array
    deviations: Array
    colours: Array | None = None

    def __len__(self) -> int:
        return len(self.points)

    def part(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> Cloud:
        """Returns the points that a mask or indices select."""
        colours = None if self.colours is None else self.colours[which]
        return Cloud(self.points[which], self.normals[which], self.deviations[which], colours)

    def thinned(self, count: int) -> Cloud:
        """Returns at most about `count` points, evenly."""
        return self.part(np.arange(0, len(self), max(1, math.ceil(len(self) / count))))


def cloud_of(
    view: View, sensor: Sensor, near: Sequence[float] | None = None, radius: float = math.inf, stride: int = 1
) -> Cloud:
    """Returns the measured points with their normals.

    The normal of a point is the direction of the smallest variance of its neighbours (H. Hoppe et al., "Surface
    reconstruction from unorganized points", 1992).

    :param near: centre of a sphere; None for the whole image.
    :param radius: of the sphere (m).
    :param stride: uses each `stride`-th row and column.
    :returns: the points inside of the sphere; too few for normals are an empty cloud.
    """
    mask = np.zeros(view.depth.shape, bool)
    mask[::stride, ::stride] = view.measured(sensor)[::stride, ::stride]
    points = view.points(mask)
    colours = None if view.rgb is None else view.rgb[mask & np.isfinite(view.depth)].astype(float)
    if near is not None:
        inside = np.linalg.norm(points - np.asarray(near), axis=1) <= radius
        points, colours = points[inside], None if colours is None else colours[inside]
    if len(points) < _NEIGHBOURS:
        return Cloud(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    rays = points - np.asarray(view.pose.position)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    _, neighbours = cKDTree(points).query(points, _NEIGHBOURS)
    around = points[neighbours]
    around -= around.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normals = axes[:, :, 0]
    normals *= -np.sign(np.einsum("ni,ni->n", normals, rays) + 1e-12)[:, None]
    # a depth error moves a point along its ray, by the error divided by the cosine of the ray's angle to the axis
    along = rays @ matrix_of(view.pose.orientation)[:, 2]
    deviations = sensor.noise / along * np.abs(np.einsum("ni,ni->n", normals, rays))
    return Cloud(points, normals, np.asarray(deviations), colours)


def view_of_points(points: Array, pose: Pose, frame: str, stamp: float) -> View:
    """Returns the view of an organised point cloud: the camera matrix follows from the points.

    :param points: height x width x 3, in the optical frame (m); NaN where nothing was measured.
    :param pose: of the optical frame in the reference frame.
    :raises WrongValue: the points are not those of a pinhole camera in its optical frame, pixel by pixel.
    """
    where = f"point cloud in {frame!r}"
    if points.ndim != 3 or points.shape[0] < 8 or points.shape[1] < 8:
        raise WrongValue(f"{where}: shape {points.shape[:2]}: expected an organised cloud, at least 8 x 8 points")
    rows, columns = np.nonzero(np.isfinite(points).all(axis=2) & (points[:, :, 2] > 0))
    if len(rows) < 100:
        raise WrongValue(f"{where}: {len(rows)} points before the camera: expected at least 100, with z forward")
    x, y, z = points[rows, columns].T
    (fx, cx), (fy, cy) = np.polyfit(x / z, columns, 1), np.polyfit(y / z, rows, 1)
    errors = np.hypot(fx * x / z + cx - columns, fy * y / z + cy - rows)
    if not (fx > 0 and fy > 0 and float(np.median(errors)) < 0.5):
        raise WrongValue(f"{where}: its points are not on the rays of its pixels: expected the camera's optical frame")
    depth = np.where(np.isfinite(points).all(axis=2), points[:, :, 2], np.nan)
    return View(depth, (float(fx), float(fy)), (float(cx), float(cy)), pose, frame, stamp)
