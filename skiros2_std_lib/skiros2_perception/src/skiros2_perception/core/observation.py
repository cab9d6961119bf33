"""Compares a view with the known objects: which are seen, and where; which are gone; what is unknown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skiros2_motion.core.geometry import Pose, Quaternion, from_euler, half_extents, to_euler
from skiros2_perception.core.association import Cluster, associated, cluster_of, least_rectangle, recognised
from skiros2_perception.core.fusion import Estimate, check_determined, estimate_of
from skiros2_perception.core.objects import KnownObject
from skiros2_perception.core.pose_estimation import registered
from skiros2_perception.core.problems import Rejected
from skiros2_perception.core.registration import Limits
from skiros2_perception.core.segmentation import clusters, find_support, heights_above
from skiros2_perception.core.transforms import Array, untransformed
from skiros2_perception.core.view import Cloud, Sensor, View, cloud_of
from skiros2_perception.core.visibility import visibility

#: The rows and columns of the image that are used for unknown objects: each second one.
_STRIDE = 2
#: Points closer to a known surface belong to it (m), or four standard deviations.
_MARGIN = 0.005
#: Minimum area of a floor or a table (m^2), minimum fraction of the points on it, maximum number of such planes.
_PLANE_AREA, _PLANE_PART, _PLANES = 0.1, 0.1, 3
#: Minimum number of points of a cluster, and minimum edge of an unknown object (m).
_CLUSTER, _SMALLEST = 30, 0.01
#: Minimum part of an object's surface in view, and of that part to be seen or absent, for a statement about it.
_IN_VIEW, _MOST = 0.5, 0.5
#: Tolerance of the depth when checking whether an object is at its place (m).
_AT_PLACE = 0.008
#: A cluster with most of its points within this distance of an object is a part of it (m).
_NEAR = 0.02
_NEAR_PLACE = Limits(points=60)
_ELSEWHERE = Limits(points=60, turn=math.pi)
#: Standard deviations of the pose of an unknown object: position (m), orientation (rad).
_POSITION, _ANGLE = 0.006, math.radians(5.0)


@dataclass(frozen=True, eq=False)
class Seen:
    """A known object that is in view.

    :param part: fraction of its surface that was seen, 0 to 1.
    :param estimate: of its pose; None if it was not located well: its pose is kept.
    :param cluster: measured size and colour of an object that perception has added; None for others.
    :param colour: mean colour; None if unknown.
    """

    id: str
    part: float
    estimate: Estimate | None
    cluster: Cluster | None = None
    colour: Array | None = None


class Absent(NamedTuple):
    """A known object that is not where it should be seen.

    :param part: fraction of its surface behind which the camera sees something, 0 to 1.
    """

    id: str
    part: float


@dataclass(frozen=True, eq=False)
class Observation:
    """A view compared with the known objects.

    :param hidden: ids of the objects that are out of view or behind others: nothing is known about them.
    :param unknown: things that are not known objects.
    """

    seen: list[Seen] = field(default_factory=list)
    absent: list[Absent] = field(default_factory=list)
    hidden: list[str] = field(default_factory=list)
    unknown: list[Cluster] = field(default_factory=list)
    stamp: float = 0.0


class _Placed(NamedTuple):
    """A known object, and the pose at which it was found."""

    seen: Seen
    thing: KnownObject
    pose: Pose


def observe(
    view: View,
    sensor: Sensor,
    known: Sequence[KnownObject],
    fixed: Sequence[KnownObject] = (),
    measured: Sequence[KnownObject] = (),
) -> Observation:
    """Compares a view with the known objects, each of which is in one list of the result.

    :param known: movable objects with a known shape.
    :param fixed: objects that do not move, such as tables: their points are ignored.
    :param measured: objects that perception has added: their sizes are measurements, too.
    """
    exact = [thing for thing in known if thing.exact]
    placed = [p for thing in exact if (p := _located(thing, [thing.pose], view, sensor, _NEAR_PLACE)) is not None]
    cloud, planes = _without_planes(_unexplained(cloud_of(view, sensor, stride=_STRIDE), fixed, placed))
    things = _clusters(cloud, planes, fixed, view)
    found = {p.thing.id for p in placed}
    waiting = [thing for thing in (*known, *measured) if thing.id not in found]
    result = Observation([p.seen for p in placed], stamp=view.stamp)
    added = {thing.id for thing in measured}

    def take(pairs: dict[int, int], objects: Sequence[KnownObject]) -> None:
        """Reports the objects of clusters as seen, and removes both from the lists."""
        for i, j in pairs.items():
            seen = _seen(things[i], objects[j], objects[j].id in added, view, sensor)
            if seen is not None:
                result.seen.append(seen)
                waiting.remove(objects[j])
                used.append(i)

    used: list[int] = []
    take(associated(things, waiting), list(waiting))
    things, used = [thing for i, thing in enumerate(things) if i not in used], []
    gone = [thing for thing in waiting if _is_absent(thing, view, sensor)]
    recognisable = [thing for thing in gone if thing.exact]
    take(recognised(things, recognisable), recognisable)
    things = [thing for i, thing in enumerate(things) if i not in used]
    for cluster in things:
        if not _is_part(cluster, [thing for thing in waiting if thing not in gone]):
            result.unknown.append(cluster)
    for thing in waiting:
        _report_unassociated(result, thing, view, sensor)
    return result


def _located(thing: KnownObject, priors: Sequence[Pose], view: View, sensor: Sensor, limits: Limits) -> _Placed | None:
    """Returns an object at the first pose that fits, near to a prior pose; None if none fits."""
    for prior in priors:
        try:
            found = registered(thing.shape, view, sensor, prior, limits)
        except Rejected:
            continue
        estimate: Estimate | None = estimate_of(found)
        try:
            check_determined(estimate_of(found))
        except Rejected:
            estimate = None
        part = found.visibility.in_view * found.visibility.seen
        seen = Seen(thing.id, part, estimate, colour=_colour_at(thing, found.pose, view))
        return _Placed(seen, thing, found.pose)
    return None


def _seen(cluster: Cluster, thing: KnownObject, is_measured: bool, view: View, sensor: Sensor) -> Seen | None:
    """Returns the object of a cluster as seen; None if its shape does not fit there."""
    if is_measured:
        return Seen(thing.id, 1.0, cluster_estimate(cluster, view.stamp), cluster, cluster.colour)
    if not thing.exact:
        return Seen(thing.id, 1.0, None, colour=cluster.colour)
    position = cluster.pose.position
    yaw = to_euler(cluster.pose.orientation)[2]
    turns: list[Quaternion] = [thing.pose.orientation, *(from_euler(0.0, 0.0, yaw + q * math.pi / 2) for q in (0, 1))]
    placed = _located(thing, [Pose(position, turn) for turn in turns], view, sensor, _ELSEWHERE)
    return None if placed is None else placed.seen


def cluster_estimate(cluster: Cluster, stamp: float) -> Estimate:
    """Returns the pose of a thing of unknown shape."""
    information = np.diag((_POSITION**-2,) * 3 + (_ANGLE**-2,) * 3)
    return Estimate(cluster.pose, information, 1.0, 0.0, 1, stamp)


def _colour_at(thing: KnownObject, pose: Pose, view: View) -> Array | None:
    """Returns the mean colour of the pixels in which an object is seen."""
    if view.rgb is None:
        return None
    measured = np.isfinite(view.depth)
    on_it = box_distances(view.points(measured), pose, thing.shape.size) < _MARGIN
    return np.asarray(view.rgb[measured][on_it].mean(axis=0)) if on_it.any() else None


def box_distances(points: Array, pose: Pose, size: Sequence[float]) -> Array:
    """Returns the distances of points (n x 3) from a box (n, m); negative inside."""
    over = np.abs(untransformed(pose, points)) - np.asarray(size) / 2
    return np.asarray(np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0))


def _unexplained(cloud: Cloud, fixed: Sequence[KnownObject], placed: Sequence[_Placed]) -> Cloud:
    """Returns the points that are on no known object."""
    margin = np.maximum(_MARGIN, 4 * cloud.deviations)
    free = np.ones(len(cloud), bool)
    for pose, thing in (*((thing.pose, thing) for thing in fixed), *((p.pose, p.thing) for p in placed)):
        free &= box_distances(cloud.points, pose, thing.shape.size) > margin
    return cloud.part(free)


def _without_planes(cloud: Cloud) -> tuple[Cloud, list[Array]]:
    """Returns the points without those on large level planes, and these planes."""
    planes: list[Array] = []
    for _ in range(_PLANES):
        plane = find_support(cloud, 0.0, math.inf, _PLANE_PART)
        if plane is None:
            break
        on_it = np.abs(heights_above(plane, cloud.points)) < np.maximum(_MARGIN, 4 * cloud.deviations)
        if not on_it.any() or float(np.prod(least_rectangle(cloud.points[on_it, :2])[2])) < _PLANE_AREA:
            break
        planes.append(plane)
        cloud = cloud.part(~on_it)
    return cloud, planes


def _clusters(cloud: Cloud, planes: Sequence[Array], fixed: Sequence[KnownObject], view: View) -> list[Cluster]:
    """Returns the things among the remaining points; without those that the border of the image cuts off."""
    found = []
    for indices in clusters(cloud.points, _CLUSTER):
        part = cloud.part(indices)
        _, pixels, _ = view.projected(part.points)
        last = np.array(view.depth.shape) - 1
        if (pixels <= _STRIDE).any() or (pixels >= last - _STRIDE).any():
            continue
        cluster = cluster_of(part, _ground(part, planes, fixed))
        if min(cluster.size) >= _SMALLEST:
            found.append(cluster)
    return found


def _ground(part: Cloud, planes: Sequence[Array], fixed: Sequence[KnownObject]) -> float | None:
    """Returns the height of the surface that a thing stands on: the highest one below it; None if none is known."""
    x, y, _ = middle = np.median(part.points, axis=0)
    heights = [float(-(plane[0] * x + plane[1] * y + plane[3]) / plane[2]) for plane in planes]
    for thing in fixed:
        top = thing.pose.position[2] + half_extents(thing.pose.orientation, thing.shape.size)[2]
        below = (float(middle[0]), float(middle[1]), top - _MARGIN)
        if box_distances(np.array([below]), thing.pose, thing.shape.size)[0] < 0:
            heights.append(top)
    low = float(part.points[:, 2].min())
    under = [height for height in heights if height < low + _MARGIN]
    return max(under) if under else None


def _is_part(cluster: Cluster, objects: Sequence[KnownObject]) -> bool:
    """Whether a cluster is a part of an object that is at its place but was not located."""
    points = cluster.points.points
    return any((box_distances(points, o.pose, o.shape.size) < _NEAR).mean() > _MOST for o in objects)


def _is_absent(thing: KnownObject, view: View, sensor: Sensor) -> bool:
    """Whether the camera sees through the place of an object. The box of an inexact object must be empty, too."""
    found = visibility(thing.shape, thing.pose, view, sensor, _AT_PLACE)
    if found.in_view < _IN_VIEW or found.absent < _MOST:
        return False
    return thing.exact or _points_inside(thing, view) < _CLUSTER


def _points_inside(thing: KnownObject, view: View) -> int:
    """Returns the number of measured points inside of an object's box, without those at its bottom."""
    points = view.points(np.isfinite(view.depth))
    inside = points[box_distances(points, thing.pose, thing.shape.size) < 0.0]
    bottom = thing.pose.position[2] - half_extents(thing.pose.orientation, thing.shape.size)[2]
    return int((inside[:, 2] > bottom + 2 * _MARGIN).sum())


def _report_unassociated(result: Observation, thing: KnownObject, view: View, sensor: Sensor) -> None:
    """Reports an object that no cluster belongs to: as absent, at its place, or hidden."""
    found = visibility(thing.shape, thing.pose, view, sensor, _AT_PLACE)
    if _is_absent(thing, view, sensor):
        result.absent.append(Absent(thing.id, found.in_view * found.absent))
    elif found.in_view >= _IN_VIEW and (found.seen >= _MOST or (not thing.exact and found.hidden < _MOST)):
        result.seen.append(Seen(thing.id, found.in_view * (1.0 - found.hidden), None))
    else:
        result.hidden.append(thing.id)
