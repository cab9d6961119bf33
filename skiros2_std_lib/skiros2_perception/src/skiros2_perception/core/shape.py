"""The shape of an object as sampled points of its surface with outward normals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.bore import Bore
from skiros2_motion.core.geometry import Quaternion, Vector, half_extents
from skiros2_perception.core.transforms import matrix_of, quaternion_of

Array = npt.NDArray[np.float64]

#: Default distance of samples (m).
SPACING = 0.002
#: Maximum number of samples of a shape; a larger shape is sampled more coarsely.
MAX_SAMPLES = 60_000
#: Edges that differ by less count as equal (m).
_EQUAL = 1e-3


@dataclass(frozen=True, eq=False)
class Shape:
    """A sampled surface in the frame of its object.

    :param points: n x 3 (m).
    :param normals: n x 3, outward unit vectors.
    :param size: edges of its bounding box (m), which is centred at the origin unless it is the shape of a model.
    :param bores: the bores of a box.
    :param is_plain: whether the shape is a box, apart from its bores.
    """

    points: Array
    normals: Array
    size: Vector
    bores: tuple[Bore, ...] = ()
    is_plain: bool = True

    @cached_property
    def tree(self) -> cKDTree:
        """The samples for searches of the nearest one."""
        return cKDTree(self.points)

    @cached_property
    def radius(self) -> float:
        """Largest distance of the surface from the origin (m)."""
        if self.is_plain:
            return math.hypot(*self.size) / 2
        return float(np.linalg.norm(self.points, axis=1).max())

    def lowest(self, orientation: Quaternion) -> float:
        """Returns the lowest height of the shape above its origin, at an orientation (m)."""
        if self.is_plain:
            return -half_extents(orientation, self.size)[2]
        return float((self.points @ matrix_of(orientation)[2]).min())

    def similar_turns(self) -> list[Quaternion]:
        """Returns the rotations after which the shape looks similar but not the same, the identity first: those that
        map the bounding box of a shape to itself, unless it is a box without bores. Registration starts from each of
        them."""
        turns = []
        if self.is_plain and not self.bores:
            return [(0.0, 0.0, 0.0, 1.0)]
        for order in itertools.permutations(range(3)):
            if all(abs(self.size[i] - self.size[order[i]]) < _EQUAL for i in range(3)):
                for signs in itertools.product((1.0, -1.0), repeat=3):
                    matrix = np.eye(3)[list(order)] * signs
                    if np.linalg.det(matrix) > 0:
                        turns.append(quaternion_of(matrix))
        return sorted(turns, key=lambda q: -abs(q[3]))


def box_shape(size: Vector, bores: Sequence[Bore] = (), spacing: float = SPACING) -> Shape:
    """Samples a box with round bores from its top face downwards. The origin is in its centre, z up.

    :param size: edges (m).
    :param spacing: distance of samples (m).
    :raises WrongValue: an edge, a bore or the spacing is unusable; the text lists all problems.
    """
    problems = [*_problems(size, bores)]
    if not 1e-5 <= spacing <= 0.1:
        problems.append(f"spacing of samples {spacing} m: expected 0.00001 to 0.1")
    if problems:
        raise WrongValue("; ".join(problems))
    area = 2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    spacing = max(spacing, math.sqrt(area / MAX_SAMPLES))
    patches = [*_faces(size, bores, spacing)]
    for bore in bores:
        patches += _bore(size[2], bore, spacing)
    points, normals = (np.vstack(parts) for parts in zip(*patches, strict=True))
    order = np.random.default_rng(0).permutation(len(points))  # any part of the samples is spread evenly
    return Shape(points[order], normals[order], (float(size[0]), float(size[1]), float(size[2])), tuple(bores))


def _problems(size: Vector, bores: Sequence[Bore]) -> list[str]:
    if len(size) != 3 or not all(math.isfinite(edge) and 1e-3 <= edge <= 100 for edge in size):
        return [f"size {tuple(size)}: expected three lengths, 0.001 to 100 m"]
    found = []
    for bore in bores:
        numbers = (bore.x, bore.y, bore.diameter, bore.depth, bore.chamfer)
        radius = bore.diameter / 2 + bore.chamfer
        if not all(map(math.isfinite, numbers)) or bore.diameter <= 0 or bore.depth <= 0 or bore.chamfer < 0:
            found.append(f"{bore}: expected a diameter and a depth above 0, and a chamfer of 0 or more")
        elif abs(bore.x) + radius > size[0] / 2 or abs(bore.y) + radius > size[1] / 2:
            found.append(f"{bore}: expected it inside of the box of {size[0]:g} x {size[1]:g} m")
    return found


def _grid(width: float, height: float, spacing: float) -> Array:
    """Returns the cell centres of a grid on a rectangle around the origin: n x 2."""
    axes = []
    for length in (width, height):
        count = max(2, round(length / spacing))
        axes.append((np.arange(count) + 0.5) / count * length - length / 2)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def _faces(size: Vector, bores: Sequence[Bore], spacing: float) -> list[tuple[Array, Array]]:
    """Returns the points and normals of the six faces, without the openings of bores."""
    patches = []
    for axis, side in itertools.product(range(3), (1.0, -1.0)):
        first, second = [other for other in range(3) if other != axis]
        flat = _grid(size[first], size[second], spacing)
        if axis == 2:
            for bore in bores:
                if side > 0 or bore.depth >= size[2]:
                    radius = bore.diameter / 2 + (bore.chamfer if side > 0 else 0.0)
                    flat = flat[np.hypot(flat[:, 0] - bore.x, flat[:, 1] - bore.y) > radius]
        points = np.empty((len(flat), 3))
        points[:, first], points[:, second], points[:, axis] = flat[:, 0], flat[:, 1], side * size[axis] / 2
        normals = np.zeros_like(points)
        normals[:, axis] = side
        patches.append((points, normals))
    return patches


def _bore(height: float, bore: Bore, spacing: float) -> list[tuple[Array, Array]]:
    """Returns the points and normals of a bore: wall, chamfer and floor."""
    top, depth, radius = height / 2, min(bore.depth, height), bore.diameter / 2
    patches = [_ring(bore, (radius, radius), (top - depth, top - bore.chamfer), spacing)]
    if bore.chamfer > 0:
        patches.append(_ring(bore, (radius, radius + bore.chamfer), (top - bore.chamfer, top), spacing))
    if bore.depth < height:
        square = _grid(bore.diameter, bore.diameter, spacing)
        flat = square[np.hypot(square[:, 0], square[:, 1]) < radius]
        points = np.column_stack((bore.x + flat[:, 0], bore.y + flat[:, 1], np.full(len(flat), top - depth)))
        patches.append((points, np.tile((0.0, 0.0, 1.0), (len(points), 1))))
    return patches


def _ring(bore: Bore, radii: tuple[float, float], heights: tuple[float, float], spacing: float) -> tuple[Array, Array]:
    """Returns the points and inward normals of a cylinder or cone between two heights."""
    length = math.hypot(heights[1] - heights[0], radii[1] - radii[0])
    rows, columns = max(2, round(length / spacing)), max(12, round(2 * math.pi * radii[1] / spacing))
    grid = np.meshgrid((np.arange(rows) + 0.5) / rows, np.arange(columns) / columns * 2 * math.pi)
    along, angle = (axis.ravel() for axis in grid)
    radius = radii[0] + along * (radii[1] - radii[0])
    height = heights[0] + along * (heights[1] - heights[0])
    points = np.column_stack((bore.x + radius * np.cos(angle), bore.y + radius * np.sin(angle), height))
    inward, up = (heights[1] - heights[0]) / length, (radii[1] - radii[0]) / length
    normals = np.column_stack((-inward * np.cos(angle), -inward * np.sin(angle), np.full(len(angle), up)))
    return points, normals
