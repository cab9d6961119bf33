"""The visibility of an object at a given pose in a depth image: seen, hidden, or missing."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.geometry import Pose
from skiros2_perception.core.shape import Shape
from skiros2_perception.core.transforms import Array, matrix_of, transformed, untransformed
from skiros2_perception.core.view import Sensor, View

#: Number of samples of a shape.
_SAMPLES = 3000
#: Surfaces that the camera sees at a flatter angle are not used (cosine).
_FLAT = 0.15


class Visibility(NamedTuple):
    """The surface that a camera would see if nothing else were there, by what it does see: fractions.

    `seen`, `hidden`, `absent` and `unknown` sum up to 1, or are 0 out of view.

    :param in_view: in the image and in range, of the surface that faces the camera.
    :param seen: measured where it is expected.
    :param hidden: something is before it.
    :param absent: the camera sees something behind it: it is not there.
    :param unknown: nothing was measured.
    """

    in_view: float
    seen: float
    hidden: float
    absent: float
    unknown: float


OUT_OF_VIEW = Visibility(0.0, 0.0, 0.0, 0.0, 0.0)


def visibility(
    shape: Shape, pose: Pose, view: View, sensor: Sensor, tolerance: float = 0.004, samples: int = _SAMPLES
) -> Visibility:
    """Compares the depth that an object would have in an image with the measured depth.

    :param pose: of the object, in the reference frame of the view.
    :param tolerance: of the depth, in addition to four standard deviations (m).
    """
    step = max(1, math.ceil(len(shape.points) / samples))
    samples_used = shape.points[::step]
    points = transformed(pose, samples_used)
    normals = shape.normals[::step] @ matrix_of(pose.orientation).T
    eye = np.asarray(view.pose.position)[None, :]
    rays = eye - points
    facing = np.einsum("ni,ni->n", normals, rays) > _FLAT * np.linalg.norm(rays, axis=1)
    if not facing.any():
        return OUT_OF_VIEW
    depths, pixels, inside = view.projected(points)
    inside &= (depths >= sensor.nearest) & (depths <= sensor.farthest)
    front = facing & inside & _through_openings(shape, samples_used, untransformed(pose, eye)[0])
    share = float((facing & inside).sum() / facing.sum())
    if not front.any():
        return Visibility(share, 0.0, 0.0, 0.0, 0.0)
    difference = _around(view.depth, pixels[front]) - depths[front]
    limit = 4 * sensor.noise + tolerance
    seen = (np.abs(difference) <= limit).any(axis=0)
    unknown = ~np.isfinite(difference).any(axis=0)
    absent = ~seen & ~(difference < -limit).any(axis=0) & ~unknown
    counts = (seen, ~seen & ~absent & ~unknown, absent, unknown)
    return Visibility(share, *(float(which.mean()) for which in counts))


def _around(depth: Array, pixels: npt.NDArray[np.int64]) -> Array:
    """Returns the depths of pixels and of their eight neighbours: 9 x n; edges are one pixel wide in any image."""
    rows, columns = pixels.T
    last = np.array(depth.shape) - 1
    shifts = itertools.product((-1, 0, 1), repeat=2)
    return np.array([depth[np.clip(rows + r, 0, last[0]), np.clip(columns + c, 0, last[1])] for r, c in shifts])


def _through_openings(shape: Shape, points: Array, eye: Array) -> npt.NDArray[np.bool_]:
    """Returns which samples the shape itself does not hide: of those in a bore, the ones whose ray to the camera passes
    through the bore's opening.

    :param eye: position of the camera in the frame of the shape.
    """
    free = np.ones(len(points), bool)
    top = shape.size[2] / 2
    for bore in shape.bores:
        radius = bore.diameter / 2 + bore.chamfer + 1e-6
        inside = (np.hypot(points[:, 0] - bore.x, points[:, 1] - bore.y) <= radius) & (points[:, 2] < top - 1e-6)
        if eye[2] <= top:
            free[inside] = False
            continue
        below = points[inside]
        crossing = below + ((top - below[:, 2]) / (eye[2] - below[:, 2]))[:, None] * (eye - below)
        free[inside] = np.hypot(crossing[:, 0] - bore.x, crossing[:, 1] - bore.y) <= radius
    return free
