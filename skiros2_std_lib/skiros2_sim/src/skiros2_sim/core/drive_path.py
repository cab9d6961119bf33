"""Plans a path for a mobile base around obstacles on the floor.

The base is a rectangle that turns in place and drives forward or backward. Between two poses it is planned as its
circumscribed circle, so that it can turn everywhere: the shortest path in the visibility graph of the obstacles,
which are enlarged by the circle's radius (T. Lozano-Perez and M. Wesley, "An algorithm for planning collision-free
paths among polyhedral obstacles", 1979). Near start and goal, where it stands at a workstation, it is planned as the
rectangle and drives straight in and out.

A path is planned in pieces (`motion.Pieces`) of at most about 1 ms.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from skiros2_common.core.errors import Refused
from skiros2_motion.core.motion import Pieces, complete

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.integer]
Shape = Any  # a polygon of shapely
Shapes = npt.NDArray[np.object_]

#: Period of the tried lengths of a straight exit from a narrow pose, and its maximum (m).
_STEP, _WAY_OUT = 0.05, 2.0
#: Clearance to obstacles on the path (m), and in narrow poses.
_MARGIN = 0.05
_TIGHT = 0.01
#: Distance of a path's corners from the enlarged obstacles (m).
_BESIDE = 0.005


class Pose2D(NamedTuple):
    """A pose of the base on the floor (m, rad)."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Obstacle:
    """An obstacle on the floor: a rectangle around (x, y), rotated by yaw; half edge lengths in m."""

    id: str
    x: float
    y: float
    yaw: float
    half_x: float
    half_y: float

    def shape(self) -> Shape:
        """Return the rectangle."""
        rectangle: Shape = _rectangles([Pose2D(self.x, self.y, self.yaw)], self.half_x, self.half_x, self.half_y)[0]
        return rectangle


@dataclass(frozen=True)
class Footprint:
    """The rectangle of the base: distances of its edges from the origin of its frame (m)."""

    front: float
    back: float
    side: float

    @property
    def radius(self) -> float:
        """Radius of the circle around its origin that contains it."""
        return math.hypot(max(self.front, self.back), self.side)

    def at(self, poses: Sequence[Pose2D]) -> Shapes:
        """Return the rectangles at poses."""
        return _rectangles(poses, self.front, self.back, self.side)


class Leg(NamedTuple):
    """A straight part of a path: drives to a point after a turn towards it; `backward`: with the rear ahead."""

    x: float
    y: float
    backward: bool


class Floor:
    """The obstacles around a base."""

    def __init__(self, footprint: Footprint, obstacles: Sequence[Obstacle]) -> None:
        self._footprint = footprint
        self._ids = [obstacle.id for obstacle in obstacles]
        self._shapes = np.array([obstacle.shape() for obstacle in obstacles], dtype=object)
        self._tree = shapely.STRtree(self._shapes)
        radius = footprint.radius + _MARGIN
        #: Where the base cannot turn: octagons around all points that are nearer than its radius.
        self._octagons = _octagons(self._shapes, radius)
        shapely.prepare(self._octagons)
        self._octagon_tree = shapely.STRtree(self._octagons)
        corners = shapely.get_coordinates(_octagons(self._shapes, radius + _BESIDE))
        #: The corners of paths: those of all octagons where the base can turn (n x 2).
        self._corners: Array = np.delete(
            corners, self._octagon_tree.query(shapely.points(corners), "within")[0], axis=0
        )

    def collision_at(self, pose: Pose2D) -> str | None:
        """Returns the id of the obstacle that the base collides with at a pose; None without one."""
        return self._hit([pose])

    def first_collision(self, start: Pose2D, legs: Sequence[Leg], ahead: float) -> str | None:
        """Returns the id of the first obstacle within `ahead` metres of the path, except those at the start."""
        touched = self._touched([start])[1]
        here = start
        for leg in legs:
            length = math.hypot(leg.x - here.x, leg.y - here.y)
            if length > 1e-6:
                part = min(1.0, ahead / length)
                end = Pose2D(here.x + part * (leg.x - here.x), here.y + part * (leg.y - here.y), heading(here, leg))
                hit = self._hit(_between(Pose2D(here.x, here.y, end.yaw), end), touched)
                if hit is not None:
                    return hit
                here = Pose2D(leg.x, leg.y, end.yaw)
            ahead -= length
            if ahead <= 0.0:
                break
        return None

    def find_path(self, start: Pose2D, goal: Pose2D) -> list[Leg]:
        """Returns the legs between two poses; the turn to the goal's yaw follows the last leg.

        :raises Refused: there is no path; names the obstacle.
        """
        return complete(self.plan(start, goal))

    def plan(self, start: Pose2D, goal: Pose2D) -> Pieces[list[Leg]]:
        """Same as `find_path`, in pieces of about 1 ms."""
        hit = self.collision_at(goal)
        if hit is not None:
            raise Refused(f"the goal is inside {hit!r}")
        yield
        direct = yield from self._direct(start, goal)
        if direct is not None:
            return direct
        out = yield from self._way_out(start, "start")
        into = yield from self._way_out(goal, "goal")
        # exit from the start, path to the exit of the goal, and the exit of the goal in reverse
        points = yield from self._search(out.pose, into.pose)
        legs = [Leg(out.pose.x, out.pose.y, out.backward)] if out.length else []
        legs += [Leg(x, y, False) for x, y in points]
        if into.length:
            legs.append(Leg(goal.x, goal.y, not into.backward))
        return legs

    def _direct(self, start: Pose2D, goal: Pose2D) -> Pieces[list[Leg] | None]:
        """Returns a single straight leg without obstacles, if there is one; backward only on short distances."""
        length = math.hypot(goal.x - start.x, goal.y - start.y)
        for backward in (False, True):
            leg = Leg(goal.x, goal.y, backward)
            if length < 1e-3:
                ways = [_turning(start, goal.yaw)]
                leg_list = []
            else:
                ahead = heading(start, leg)
                if backward and (length > _WAY_OUT or abs(wrapped(ahead - goal.yaw)) > 0.5):
                    continue
                turned = Pose2D(start.x, start.y, ahead)
                arrived = Pose2D(goal.x, goal.y, ahead)
                ways = [_turning(start, ahead), _between(turned, arrived), _turning(arrived, goal.yaw)]
                leg_list = [leg]
            if all(self._hit(way) is None for way in ways):
                return leg_list
            yield
        return None

    def _way_out(self, pose: Pose2D, what: str) -> Pieces[_WayOut]:
        """Returns the nearest pose straight ahead or behind where the base can turn."""
        blocking = None
        touched = self._touched([pose])[1]
        for step in range(int(_WAY_OUT / _STEP) + 1):
            for backward in (True, False):
                length = step * _STEP
                sign = -length if backward else length
                free = Pose2D(pose.x + sign * math.cos(pose.yaw), pose.y + sign * math.sin(pose.yaw), pose.yaw)
                if self._near(free.x, free.y) is not None:
                    continue
                blocking = self._hit(_between(pose, free), touched)
                if blocking is None:
                    return _WayOut(free, backward, length)
            yield
        blocking = blocking or self._near(pose.x, pose.y)
        raise Refused(f"no way out of the {what}: {blocking!r} is in the way")

    def _near(self, x: float, y: float) -> str | None:
        """Returns the id of an obstacle that prevents a turn at a point; None without one."""
        near = self._octagon_tree.query(shapely.Point(x, y), "within")
        return self._ids[min(near)] if len(near) else None

    def _search(self, start: Pose2D, goal: Pose2D) -> Pieces[list[tuple[float, float]]]:
        """Returns the corners of the shortest path of the circle, without the start (Dijkstra's algorithm).

        :raises Refused: there is none.
        """
        points = np.vstack(((start.x, start.y), (goal.x, goal.y), self._corners))
        lengths, before, closed = {0: 0.0}, {0: 0}, set()
        waiting = [(0.0, 0)]
        blocking: set[int] = set()
        while waiting:
            length, here = heapq.heappop(waiting)
            if here in closed:
                continue
            closed.add(here)
            if here == 1:
                path = [here]
                while before[path[-1]] != 0:
                    path.append(before[path[-1]])
                return [(float(points[k, 0]), float(points[k, 1])) for k in reversed(path)]
            blocked, by = self._blocked(points[here], points)
            blocking |= by
            distances = np.hypot(*(points - points[here]).T)
            for there in np.flatnonzero(~blocked).tolist():
                further = length + float(distances[there])
                if further < lengths.get(there, math.inf):
                    lengths[there], before[there] = further, here
                    heapq.heappush(waiting, (further, there))
            yield
        raise Refused(f"no path to the goal: {self._names(sorted(blocking), goal)} in the way")

    def _blocked(self, start: Array, ends: Array) -> tuple[npt.NDArray[np.bool_], set[int]]:
        """Return which straight lines from a point to others are blocked, and the octagons that do so."""
        lines = shapely.linestrings(np.stack((np.broadcast_to(start, ends.shape), ends), axis=1))
        near, octagons = self._octagon_tree.query(lines)
        crossed = shapely.intersects(self._octagons[octagons], lines[near])
        blocked = np.zeros(len(ends), dtype=bool)
        blocked[near[crossed]] = True
        return blocked, set(octagons[crossed].tolist())

    def _names(self, indices: Sequence[int], goal: Pose2D) -> str:
        """Names obstacles, the nearest to the goal first."""
        at = shapely.Point(goal.x, goal.y)
        nearest = sorted(indices, key=lambda k: float(shapely.distance(self._shapes[k], at)))
        names = [repr(self._ids[k]) for k in nearest]
        rest = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return f"{', '.join(names[:3])}{rest} {'is' if len(names) == 1 else 'are'}"

    def _touched(self, poses: Sequence[Pose2D]) -> tuple[Indices, Indices]:
        """Return the pairs of a pose and an obstacle that the base touches there: two lists of indices."""
        poses_at, obstacles = self._tree.query(self._footprint.at(poses), "dwithin", _TIGHT)
        return poses_at, obstacles

    def _hit(self, poses: Sequence[Pose2D], ignored: Indices | None = None) -> str | None:
        """Return the id of the first obstacle that the base touches in one of the poses.

        :param ignored: obstacles.
        """
        at, obstacles = self._touched(poses)
        hits = [pair for pair in zip(at, obstacles, strict=True) if ignored is None or pair[1] not in ignored]
        return self._ids[min(hits)[1]] if hits else None


class _WayOut(NamedTuple):
    pose: Pose2D
    backward: bool
    length: float


def _rectangles(poses: Sequence[Pose2D], front: float, back: float, side: float) -> Shapes:
    at = np.array(poses)
    c, s = np.cos(at[:, 2:]), np.sin(at[:, 2:])
    x, y = np.array((front, front, -back, -back)), np.array((-side, side, side, -side))
    corners = np.stack((at[:, :1] + c * x - s * y, at[:, 1:2] + s * x + c * y), axis=-1)
    rectangles: Shapes = shapely.polygons(corners)
    return rectangles


def _octagons(rectangles: Shapes, radius: float) -> Shapes:
    """Return the octagons around all points that are nearer to a rectangle than a radius."""
    # a mitre limit of 1 cuts each corner with a line that touches the circle around it
    octagons: Shapes = shapely.buffer(rectangles, radius, join_style="mitre", mitre_limit=1.0)
    return octagons


def heading(here: Pose2D, leg: Leg) -> float:
    """Returns the yaw of the base on a leg."""
    yaw = math.atan2(leg.y - here.y, leg.x - here.x)
    return wrapped(yaw + math.pi) if leg.backward else yaw


def _between(a: Pose2D, b: Pose2D) -> list[Pose2D]:
    """Returns poses on a straight line, at most 4 cm apart, with the yaw of the first."""
    n = max(2, math.ceil(math.hypot(b.x - a.x, b.y - a.y) / 0.04) + 1)
    return [Pose2D(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.yaw) for t in np.linspace(0.0, 1.0, n)]


def _turning(pose: Pose2D, yaw: float) -> list[Pose2D]:
    """Returns poses of a turn in place, at most 0.1 rad apart, in the shorter direction."""
    way = wrapped(yaw - pose.yaw)
    n = max(2, math.ceil(abs(way) / 0.1) + 1)
    return [Pose2D(pose.x, pose.y, pose.yaw + t * way) for t in np.linspace(0.0, 1.0, n)]


def wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)
