"""Segmentation of points: the plane that things stand on, and clusters."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skiros2_perception.core.transforms import Array
from skiros2_perception.core.view import Cloud

#: Maximum angle between the normal of a supporting plane and the vertical (cosine).
_LEVEL = math.cos(math.radians(10.0))
_TRIALS = 60
#: Size of the voxels of clusters, and maximum distance of neighbouring ones (m).
_VOXEL, _GAP = 0.005, 0.012


def find_support(cloud: Cloud, height: float, band: float, part: float = 0.03) -> Array | None:
    """Returns the level plane with most points, as (nx, ny, nz, d) with n upward and n p + d = 0; None without one.

    RANSAC (M. Fischler and R. Bolles, 1981) over points with vertical normals, then least squares over the inliers. The
    search is the same for the same points.

    :param height: expected height, along z of the reference frame (m).
    :param band: maximum distance of a point from it (m).
    :param part: minimum fraction of the points.
    """
    level = (cloud.normals[:, 2] > _LEVEL) & (np.abs(cloud.points[:, 2] - height) <= band)
    points = cloud.points[level]
    if len(points) < max(30, part * len(cloud)):
        return None
    tolerance = 3 * float(np.median(cloud.deviations[level]))
    random = np.random.default_rng(len(points))
    best = np.zeros(len(points), bool)
    for _ in range(_TRIALS):
        a, b, c = points[random.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-6 or abs(normal[2]) / length < _LEVEL:
            continue
        inliers = np.abs((points - a) @ (normal / length)) < tolerance
        if inliers.sum() > best.sum():
            best = inliers
    if best.sum() < max(30, part * len(cloud)):
        return None
    middle = points[best].mean(axis=0)
    normal = np.linalg.svd(points[best] - middle, full_matrices=False)[2][2]
    normal = normal * np.sign(normal[2])
    return np.array((*normal, -normal @ middle))


def heights_above(plane: Array, points: Array) -> Array:
    """Returns the signed distances of points (n x 3) from a plane (n, m)."""
    return np.asarray(points @ plane[:3] + plane[3])


def clusters(points: Array, least: int = 40) -> list[npt.NDArray[np.int64]]:
    """Returns the indices of the points of each cluster, the largest first.

    Euclidean clusters (R. B. Rusu, "Semantic 3D object maps", 2009) of voxels of 5 mm, connected when closer than
    12 mm.

    :param points: n x 3 (m).
    :param least: minimum number of points of a cluster.
    """
    if len(points) == 0:
        return []
    voxels, of_point = np.unique(np.floor(points / _VOXEL).astype(np.int64), axis=0, return_inverse=True)
    pairs = cKDTree((voxels + 0.5) * _VOXEL).query_pairs(_GAP, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(voxels),) * 2)
    labels = connected_components(graph, directed=False)[1][of_point.ravel()]
    found = [np.flatnonzero(labels == label) for label in np.flatnonzero(np.bincount(labels) >= least)]
    return sorted(found, key=len, reverse=True)
