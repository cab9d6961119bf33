"""Shapes from CAD models: triangles from STL and OBJ files, sampled evenly."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from skiros2_common.core.errors import WrongValue
from skiros2_perception.core.shape import MAX_SAMPLES, SPACING, Array, Shape

#: Types of files that are read.
MESHES = (".obj", ".stl")
#: Bounds of the edges of a model (m): others are not in metres. Minimum number of samples.
_SMALLEST, _LARGEST, _LEAST = 1e-3, 100.0, 2000
#: Of a binary STL: bytes before the triangles, and a triangle.
_STL_HEADER = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def mesh_shape(file: Path, spacing: float = SPACING) -> Shape:
    """Samples the surface of a model. The frame is that of the file.

    :param file: a closed surface in metres, whose triangles have their corners counterclockwise seen from outside, or
        all of them clockwise.
    :param spacing: mean distance of samples (m).
    :raises WrongValue: the file cannot be read, or the surface is unusable.
    """
    corners = read_triangles(file)
    size = corners.reshape(-1, 3).max(axis=0) - corners.reshape(-1, 3).min(axis=0)
    if not (np.isfinite(corners).all() and size.min() >= _SMALLEST and size.max() <= _LARGEST):
        raise WrongValue(f"model {file}: size {_text(size)}: expected edges of {_SMALLEST:g} to {_LARGEST:g} m")
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(across, axis=1)
    # six times the volume, from the middle: negative if the triangles face inwards
    middle = corners.reshape(-1, 3).mean(axis=0)
    volume = float(np.einsum("ni,ni->n", corners[:, 0] - middle, across).sum())
    if abs(volume) < 1e-3 * 6 * float(size.prod()):
        raise WrongValue(f"model {file}: expected a closed surface with triangles that all face outwards")
    area = float(doubled.sum()) / 2
    count = min(MAX_SAMPLES, max(_LEAST, math.ceil(area / spacing**2)))
    random = np.random.default_rng(0)
    chosen = random.choice(len(corners), count, p=doubled / doubled.sum())
    a, b = random.uniform(size=(2, count, 1))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    first, second, third = (corners[chosen, i] for i in range(3))
    points = first + a * (second - first) + b * (third - first)
    normals = math.copysign(1.0, volume) * across[chosen] / doubled[chosen, None]
    return Shape(points, normals, (float(size[0]), float(size[1]), float(size[2])), is_plain=False)


def read_triangles(file: Path) -> Array:
    """Reads the corners of triangles: n x 3 x 3, in the units of the file.

    :raises WrongValue: the file cannot be read, or has no triangles.
    """
    if file.suffix.lower() not in MESHES:
        raise WrongValue(f"model {file}: expected one of {', '.join(MESHES)}")
    try:
        found = _read_obj(file.read_text()) if file.suffix.lower() == ".obj" else _read_stl(file.read_bytes())
    except OSError as error:
        raise WrongValue(f"model {file}: {error.strerror}") from None
    except (ValueError, IndexError) as error:
        raise WrongValue(f"model {file}: expected a mesh: {error}") from None
    if not len(found):
        raise WrongValue(f"model {file}: it has no triangles")
    return found


def _read_stl(data: bytes) -> Array:
    """Reads a binary or textual STL.

    :raises ValueError: it is broken.
    """
    count = int.from_bytes(data[_STL_HEADER - 4 : _STL_HEADER], "little")
    if len(data) == _STL_HEADER + count * _STL_TRIANGLE.itemsize:  # textual ones may begin like binary ones
        return np.asarray(np.frombuffer(data[_STL_HEADER:], _STL_TRIANGLE)["corners"], float)
    lines = [line.split() for line in data.decode("ascii").splitlines()]
    corners = np.array([line[1:] for line in lines if line and line[0] == "vertex"], float)
    return corners.reshape(-1, 3, 3)


def _read_obj(text: str) -> Array:
    """Reads the faces of an OBJ; polygons become fans of triangles.

    :raises ValueError: it is broken.
    :raises IndexError: a face has a corner that does not exist.
    """
    lines = [line.split() for line in text.splitlines()]
    corners = np.array([line[1:4] for line in lines if line and line[0] == "v"], float).reshape(-1, 3)
    triangles = []
    for line in lines:
        if line and line[0] == "f":
            # from 1; negative numbers count from the end
            numbers = [int(part.partition("/")[0]) for part in line[1:]]
            face = [number - 1 if number > 0 else len(corners) + number for number in numbers]
            if min(face) < 0:
                raise IndexError(f"face {' '.join(line[1:])}")
            triangles += [(face[0], *face[i : i + 2]) for i in range(1, len(face) - 1)]
    return np.asarray(corners[np.array(triangles, int).reshape(-1, 3)])


def _text(size: Array) -> str:
    return " x ".join(f"{edge:g}" for edge in size) + " m"
