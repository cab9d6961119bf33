"""Which measured cluster is which object: by class, distance and appearance.

The caller selects the objects by class. The costs are squared Mahalanobis distances: of position, size and mean colour.
The assignment with the smallest sum of costs is chosen (Hungarian algorithm: H. Kuhn, 1955), among pairs within the
limit. An object that has moved farther than its covariance explains is recognised by its appearance only, if no other
object and no other cluster look the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, QhullError
from scipy.stats import chi2

from skiros2_motion.core.geometry import Pose, Vector, from_euler, half_extents
from skiros2_perception.core.objects import KnownObject
from skiros2_perception.core.transforms import Array
from skiros2_perception.core.view import Cloud

#: Standard deviations of a measured cluster: of its centre and size (m), and of its mean colour (0 to 255).
_CENTRE, _SIZE, _COLOUR = 0.006, 0.006, 25.0
#: Relative standard deviation of the size.
_RELATIVE = 0.05
#: Probability of a larger distance of a cluster from its object.
_OUTLIER = 1e-3
_FORBIDDEN = 1e9


class Cluster(NamedTuple):
    """A measured thing: an upright box around its points.

    :param pose: of the centre of the box in the reference frame.
    :param size: edges (m).
    :param colour: mean red, green, blue, 0 to 255; None without colours.
    :param points: its points.
    """

    pose: Pose
    size: Vector
    colour: Array | None
    points: Cloud


def cluster_of(points: Cloud, bottom: float | None) -> Cluster:
    """Returns the smallest upright box around points.

    :param bottom: height of the surface that the thing stands on (m); None for that of the lowest point.
    """
    angle, middle, edges = least_rectangle(points.points[:, :2])
    low, high = np.percentile(points.points[:, 2], (0.5, 99.5))
    low = float(low) if bottom is None else bottom
    pose = Pose((float(middle[0]), float(middle[1]), float(low + high) / 2), from_euler(0.0, 0.0, angle))
    colour = None if points.colours is None else np.asarray(points.colours.mean(axis=0))
    return Cluster(pose, (float(edges[0]), float(edges[1]), float(high) - low), colour, points)


def least_rectangle(points: Array) -> tuple[float, Array, Array]:
    """Returns angle (rad, 0 to pi / 2), centre and edges of the minimum-area rectangle around points of a plane
    (n x 2). One of its edges lies on an edge of the hull (H. Freeman and R. Shapira, 1975)."""
    try:
        hull = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # fewer than three, or on a line
        hull = points
    best: tuple[float, float, Array, Array] | None = None
    edges = np.diff(np.vstack((hull, hull[:1])), axis=0)
    for angle in np.unique(np.arctan2(edges[:, 1], edges[:, 0]) % (math.pi / 2)):
        axes = np.array(((math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))))
        turned = hull @ axes.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        area = float(np.prod(high - low))
        if best is None or area < best[0]:
            best = (area, float(angle), (low + high) / 2 @ axes, high - low)
    assert best is not None
    return best[1], best[2], best[3]


def associated(clusters: Sequence[Cluster], objects: Sequence[KnownObject]) -> dict[int, int]:
    """Returns the index of the object of each associated cluster, by distance and appearance."""
    return _assigned(clusters, objects, lambda c, o: _position_cost(c, o) + _appearance_cost(c, o), 3)


def recognised(clusters: Sequence[Cluster], objects: Sequence[KnownObject]) -> dict[int, int]:
    """Returns the index of the object of each cluster that is recognised by its appearance alone: only pairs in which
    neither fits another one."""
    fits = [(i, j) for i, c in enumerate(clusters) for j, o in enumerate(objects) if _looks_alike(c, o)]
    return {i: j for i, j in fits if sum(a == i for a, _ in fits) == 1 and sum(b == j for _, b in fits) == 1}


def _assigned(
    clusters: Sequence[Cluster],
    objects: Sequence[KnownObject],
    cost: Callable[[Cluster, KnownObject], float],
    degrees: int,
) -> dict[int, int]:
    if not clusters or not objects:
        return {}
    costs = np.full((len(clusters), len(objects)), _FORBIDDEN)
    for i, cluster in enumerate(clusters):
        for j, known in enumerate(objects):
            value = cost(cluster, known)
            if value <= chi2.isf(_OUTLIER, degrees + _appearance_degrees(cluster, known)):
                costs[i, j] = value
    rows, columns = linear_sum_assignment(costs)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if costs[i, j] < _FORBIDDEN}


def _looks_alike(cluster: Cluster, known: KnownObject) -> bool:
    return bool(_appearance_cost(cluster, known) <= chi2.isf(_OUTLIER, _appearance_degrees(cluster, known)))


def _appearance_degrees(cluster: Cluster, known: KnownObject) -> int:
    return 3 if cluster.colour is None or known.colour is None else 6


def _position_cost(cluster: Cluster, known: KnownObject) -> float:
    error = np.subtract(cluster.pose.position, known.pose.position)
    covariance = known.covariance[:3, :3] + np.eye(3) * _CENTRE**2
    return float(error @ np.linalg.solve(covariance, error))


def _appearance_cost(cluster: Cluster, known: KnownObject) -> float:
    """Returns the squared distance of size and colour. The size is that of the known object's upright outline."""
    half = half_extents(known.pose.orientation, known.shape.size)
    tall = 2 * half[2]
    level = sorted(edge for edge in known.shape.size)
    level.remove(min(level, key=lambda edge: abs(edge - tall)))
    expected = np.array((*level, tall))
    error = np.array((*sorted(cluster.size[:2]), cluster.size[2])) - expected
    cost = float(np.sum((error / (_SIZE + _RELATIVE * expected)) ** 2))
    if cluster.colour is not None and known.colour is not None:
        cost += float(np.sum(((cluster.colour - known.colour) / _COLOUR) ** 2))
    return cost
