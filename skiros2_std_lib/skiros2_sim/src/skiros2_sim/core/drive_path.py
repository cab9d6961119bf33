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
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused
from skiros2_motion.core.motion import Pieces, complete

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.integer]

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

    def distance(self, x: Array, y: Array) -> Array:
        """Returns the distances of points from its edge (m); 0 inside."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        dx, dy = x - self.x, y - self.y
        outside_x = np.maximum(np.abs(c * dx + s * dy) - self.half_x, 0.0)
        outside_y = np.maximum(np.abs(c * dy - s * dx) - self.half_y, 0.0)
        distance: Array = np.hypot(outside_x, outside_y)
        return distance

    def octagon(self, radius: float) -> tuple[Array, Array]:
        """Returns the octagon around all points closer than a radius (m): outward normals (8 x 2), counterclockwise,
        and the distances of its edges from the origin."""
        half = self.half_x, self.half_y
        angles = np.arange(8) * (math.pi / 4)
        normals = np.stack((np.cos(angles + self.yaw), np.sin(angles + self.yaw)), axis=1)
        reach = np.abs(np.cos(angles)) * half[0] + np.abs(np.sin(angles)) * half[1] + radius
        return normals, reach + normals @ (self.x, self.y)


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

    def outline(self) -> tuple[Array, Array]:
        """Points on the outline, at most 5 cm apart, in the base's frame."""
        xs = np.linspace(-self.back, self.front, max(2, math.ceil((self.front + self.back) / 0.05) + 1))
        ys = np.linspace(-self.side, self.side, max(2, math.ceil(2 * self.side / 0.05) + 1))
        x, y = np.meshgrid(xs, ys)
        return x.ravel(), y.ravel()


class Leg(NamedTuple):
    """A straight part of a path: drives to a point after a turn towards it; `backward`: with the rear ahead."""

    x: float
    y: float
    backward: bool


class Floor:
    """The obstacles around a base."""

    def __init__(self, footprint: Footprint, obstacles: Sequence[Obstacle]) -> None:
        self._outline = footprint.outline()
        self._obstacles = tuple(obstacles)
        octagons = [o.octagon(footprint.radius + _MARGIN) for o in obstacles]
        #: Where the base cannot turn: normals (n x 8 x 2) and distances from the origin (n x 8) of the octagons' edges.
        self._normals = np.array([normals for normals, _ in octagons]).reshape(-1, 8, 2)
        self._reach = np.array([reach for _, reach in octagons]).reshape(-1, 8)

    def collision_at(self, pose: Pose2D) -> str | None:
        """Returns the id of the obstacle that the base collides with at a pose; None without one."""
        return _hit(self._outline, self._obstacles, [pose])

    def first_collision(self, start: Pose2D, legs: Sequence[Leg], ahead: float) -> str | None:
        """Returns the id of the first obstacle within `ahead` metres of the path, except those at the start."""
        others = self._not_touched(start)
        here = start
        for leg in legs:
            length = math.hypot(leg.x - here.x, leg.y - here.y)
            if length > 1e-6:
                part = min(1.0, ahead / length)
                end = Pose2D(here.x + part * (leg.x - here.x), here.y + part * (leg.y - here.y), heading(here, leg))
                hit = _hit(self._outline, others, _between(Pose2D(here.x, here.y, end.yaw), end))
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
            if all(_hit(self._outline, self._obstacles, way) is None for way in ways):
                return leg_list
            yield
        return None

    def _way_out(self, pose: Pose2D, what: str) -> Pieces[_WayOut]:
        """Returns the nearest pose straight ahead or behind where the base can turn."""
        blocking = None
        others = self._not_touched(pose)
        for step in range(int(_WAY_OUT / _STEP) + 1):
            for backward in (True, False):
                length = step * _STEP
                sign = -length if backward else length
                free = Pose2D(pose.x + sign * math.cos(pose.yaw), pose.y + sign * math.sin(pose.yaw), pose.yaw)
                if self._near(free.x, free.y) is not None:
                    continue
                blocking = _hit(self._outline, others, _between(pose, free))
                if blocking is None:
                    return _WayOut(free, backward, length)
            yield
        blocking = blocking or self._near(pose.x, pose.y)
        raise Refused(f"no way out of the {what}: {blocking!r} is in the way")

    def _near(self, x: float, y: float) -> str | None:
        """Returns the id of an obstacle that prevents a turn at a point; None without one."""
        near = np.flatnonzero((self._normals @ (x, y) < self._reach).all(axis=1))
        return self._obstacles[near[0]].id if len(near) else None

    def _search(self, start: Pose2D, goal: Pose2D) -> Pieces[list[tuple[float, float]]]:
        """Returns the corners of the shortest path of the circle, without the start (Dijkstra's algorithm).

        :raises Refused: there is none.
        """
        points = np.vstack(((start.x, start.y), (goal.x, goal.y), self._corners()))
        lengths, before, closed = {0: 0.0}, {0: 0}, set()
        waiting = [(0.0, 0)]
        blocking = np.zeros(len(self._obstacles), dtype=bool)
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
            blocked = self._blocked(points[here], points)
            blocking |= blocked.any(axis=0)
            distances = np.hypot(*(points - points[here]).T)
            for there in np.flatnonzero(~blocked.any(axis=1)).tolist():
                further = length + float(distances[there])
                if further < lengths.get(there, math.inf):
                    lengths[there], before[there] = further, here
                    heapq.heappush(waiting, (further, there))
            yield
        raise Refused(f"no path to the goal: {self._names(np.flatnonzero(blocking), goal)} in the way")

    def _corners(self) -> Array:
        """Returns the corners of all octagons where the base can turn (n x 2)."""
        reach = self._reach + _BESIDE
        # the intersection of an edge with the next one, which is turned by an eighth
        along = (np.roll(reach, -1, axis=1) - reach * math.cos(math.pi / 4)) / math.sin(math.pi / 4)
        tangents = np.stack((-self._normals[..., 1], self._normals[..., 0]), axis=-1)
        corners = (reach[..., None] * self._normals + along[..., None] * tangents).reshape(-1, 2)
        inside = (np.einsum("oek,ck->coe", self._normals, corners) < self._reach).all(axis=2).any(axis=1)
        free: Array = corners[~inside]
        return free

    def _blocked(self, start: Array, ends: Array) -> npt.NDArray[np.bool_]:
        """Returns which octagons (columns) block the straight lines from a point to others (rows)."""
        ahead = self._reach - self._normals @ start  # distance to each edge's line, o x e; negative outside
        speed = np.einsum("oek,ck->coe", self._normals, ends - start)  # towards it
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = ahead / speed
        entry = np.where(speed < 0, crossing, np.where((speed == 0) & (ahead <= 0), np.inf, -np.inf)).max(axis=2)
        leaving = np.where(speed > 0, crossing, np.inf).min(axis=2)
        blocked: npt.NDArray[np.bool_] = np.maximum(entry, 0.0) < np.minimum(leaving, 1.0)
        return blocked

    def _names(self, indices: Indices, goal: Pose2D) -> str:
        """Names obstacles, the nearest to the goal first."""
        at = np.array([goal.x]), np.array([goal.y])
        found = sorted((self._obstacles[k] for k in indices), key=lambda o: float(o.distance(*at)[0]))
        names = [repr(obstacle.id) for obstacle in found]
        rest = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return f"{', '.join(names[:3])}{rest} {'is' if len(names) == 1 else 'are'}"

    def _not_touched(self, pose: Pose2D) -> list[Obstacle]:
        """Returns the obstacles that the base does not touch at a pose."""
        return [obstacle for obstacle in self._obstacles if _hit(self._outline, [obstacle], [pose]) is None]


class _WayOut(NamedTuple):
    pose: Pose2D
    backward: bool
    length: float


def _hit(outline: tuple[Array, Array], obstacles: Sequence[Obstacle], poses: Sequence[Pose2D]) -> str | None:
    """Returns the id of the first obstacle that the base's rectangle touches in one of the poses."""
    at = np.array(poses)
    reach = float(np.hypot(*outline).max()) + _TIGHT
    first: tuple[int, str] | None = None
    for obstacle in obstacles:
        near = np.flatnonzero(obstacle.distance(at[:, 0], at[:, 1]) < reach)
        c, s = np.cos(at[near, 2])[:, None], np.sin(at[near, 2])[:, None]
        x = at[near, 0][:, None] + c * outline[0] - s * outline[1]
        y = at[near, 1][:, None] + s * outline[0] + c * outline[1]
        touched = near[(obstacle.distance(x, y) < _TIGHT).any(axis=1)]
        if len(touched) and (first is None or touched[0] < first[0]):
            first = int(touched[0]), obstacle.id
    return first[1] if first else None


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
