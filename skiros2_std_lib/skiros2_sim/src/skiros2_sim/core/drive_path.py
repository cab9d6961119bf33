"""Plans a path for a mobile base around obstacles on the floor.

The base is a rectangle that turns in place and drives forward or backward. Between two poses it is planned as its
circumscribed circle, so that it can turn everywhere. Near start and goal, where it stands at a workstation, it is
planned as the rectangle and drives straight in and out.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import Refused

Array = npt.NDArray[np.floating[Any]]

#: Cell size of the grid map (m), and its border around the relevant area (m).
_CELL = 0.05
_AROUND = 2.0
#: Maximum number of cells per side; larger maps have larger cells.
_MAX_CELLS = 400
#: Maximum length of a straight exit from a narrow pose (m).
_WAY_OUT = 2.0
#: Clearance to obstacles on the path (m), and in narrow poses.
_MARGIN = 0.05
_TIGHT = 0.01
#: Part of the clearance that a straight line between cells may use (m).
_CUT = 0.04


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
        self._free_radius = footprint.radius + _MARGIN

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
        hit = self.collision_at(goal)
        if hit is not None:
            raise Refused(f"the goal is inside {hit!r}")
        direct = self._direct(start, goal)
        if direct is not None:
            return direct
        out = self._way_out(start, "start")
        into = self._way_out(goal, "goal")
        # exit from the start, path to the exit of the goal, and the exit of the goal in reverse
        points = self._search(out.pose, into.pose)
        legs = [Leg(out.pose.x, out.pose.y, out.backward)] if out.length else []
        legs += [Leg(x, y, False) for x, y in points]
        if into.length:
            legs.append(Leg(goal.x, goal.y, not into.backward))
        return legs

    def _direct(self, start: Pose2D, goal: Pose2D) -> list[Leg] | None:
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
        return None

    def _way_out(self, pose: Pose2D, what: str) -> _WayOut:
        """Returns the nearest pose straight ahead or behind where the base can turn."""
        blocking = None
        others = self._not_touched(pose)
        for step in range(int(_WAY_OUT / _CELL) + 1):
            for backward in (True, False):
                length = step * _CELL
                sign = -length if backward else length
                free = Pose2D(pose.x + sign * math.cos(pose.yaw), pose.y + sign * math.sin(pose.yaw), pose.yaw)
                if self._near(free.x, free.y) is not None:
                    continue
                blocking = _hit(self._outline, others, _between(pose, free))
                if blocking is None:
                    return _WayOut(free, backward, length)
        blocking = blocking or self._near(pose.x, pose.y)
        raise Refused(f"no way out of the {what}, {blocking!r} is in the way")

    def _near(self, x: float, y: float) -> str | None:
        """Returns the id of an obstacle that prevents a turn at a point; None without one."""
        at = np.array([x]), np.array([y])
        for obstacle in self._obstacles:
            if obstacle.distance(*at)[0] < self._free_radius:
                return obstacle.id
        return None

    def _not_touched(self, pose: Pose2D) -> list[Obstacle]:
        """Returns the obstacles that the base does not touch at a pose."""
        return [obstacle for obstacle in self._obstacles if _hit(self._outline, [obstacle], [pose]) is None]

    def _search(self, start: Pose2D, goal: Pose2D) -> list[tuple[float, float]]:
        """Returns the corners of the shortest path of the circle, without the start (A* on a grid, simplified)."""
        grid = _Grid(self._obstacles, start, goal, self._free_radius)
        return grid.search(start, goal)


class _WayOut(NamedTuple):
    pose: Pose2D
    backward: bool
    length: float


class _Grid:
    """A grid map around start, goal and obstacles."""

    def __init__(self, obstacles: Sequence[Obstacle], start: Pose2D, goal: Pose2D, radius: float) -> None:
        reach = _AROUND + radius
        near = [o for o in obstacles if _is_near(o, start, goal)]
        spread = [math.hypot(o.half_x, o.half_y) for o in near]
        xs = [start.x, goal.x, *(o.x - r for o, r in zip(near, spread, strict=True))]
        xs += [o.x + r for o, r in zip(near, spread, strict=True)]
        ys = [start.y, goal.y, *(o.y - r for o, r in zip(near, spread, strict=True))]
        ys += [o.y + r for o, r in zip(near, spread, strict=True)]
        self._x0, self._y0 = min(xs) - reach, min(ys) - reach
        width, height = max(xs) + reach - self._x0, max(ys) + reach - self._y0
        self._cell = max(_CELL, width / _MAX_CELLS, height / _MAX_CELLS)
        self._columns, self._rows = math.ceil(width / self._cell) + 1, math.ceil(height / self._cell) + 1
        x = self._x0 + np.arange(self._columns)[None, :] * self._cell
        y = self._y0 + np.arange(self._rows)[:, None] * self._cell
        self._blocked = np.zeros((self._rows, self._columns), dtype=bool)
        for obstacle in obstacles:
            # no obstacle fits between neighbouring free cells: coarse maps need more clearance
            self._blocked |= obstacle.distance(x, y) < radius + self._cell - _CELL
        self._obstacles, self._radius = tuple(obstacles), radius

    def search(self, start: Pose2D, goal: Pose2D) -> list[tuple[float, float]]:
        """Returns the corners of a path from start to goal.

        :raises Refused: there is none.
        """
        first, last = self._square(start), self._square(goal)
        for square in (first, last):
            # the pose is free, its cell may not be
            self._blocked[square] = False
        if self._sees((start.x, start.y), (goal.x, goal.y)):
            return [(goal.x, goal.y)]
        came_from = self._expanded(first, last)
        squares = [last]
        while squares[-1] != first:
            squares.append(came_from[squares[-1]])
        points = [self._point(square) for square in reversed(squares)]
        points[0], points[-1] = (start.x, start.y), (goal.x, goal.y)
        return self._cut(points)[1:]

    def _expanded(self, first: tuple[int, int], last: tuple[int, int]) -> dict[tuple[int, int], tuple[int, int]]:
        """Searches with A*; the heuristic is the length of diagonal and straight steps."""
        came_from: dict[tuple[int, int], tuple[int, int]] = {}
        cost = {first: 0.0}
        queue = [(0.0, first)]
        done: set[tuple[int, int]] = set()
        blocked = self._blocked
        while queue:
            _, here = heapq.heappop(queue)
            if here == last:
                return came_from
            if here in done:
                continue
            done.add(here)
            for dr, dc, length in _STEPS:
                there = here[0] + dr, here[1] + dc
                if not (0 <= there[0] < self._rows and 0 <= there[1] < self._columns) or blocked[there]:
                    continue
                new = cost[here] + length
                if new < cost.get(there, math.inf):
                    cost[there] = new
                    came_from[there] = here
                    across, along = abs(there[0] - last[0]), abs(there[1] - last[1])
                    estimate = max(across, along) + (math.sqrt(2) - 1) * min(across, along)
                    heapq.heappush(queue, (new + estimate, there))
        raise Refused(f"no way there, {self._enclosing(done, self._point(last))} in the way")

    def _enclosing(self, seen: set[tuple[int, int]], goal: tuple[float, float]) -> str:
        """Names the obstacles around the reachable cells, the nearest to the goal first."""
        points = np.array([self._point(square) for square in seen])
        reach = self._radius + 2 * self._cell
        around = [o for o in self._obstacles if o.distance(points[:, 0], points[:, 1]).min() < reach]
        at = np.array([goal[0]]), np.array([goal[1]])
        names = [repr(o.id) for o in sorted(around, key=lambda o: float(o.distance(*at)[0]))]
        rest = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return f"{', '.join(names[:3])}{rest} {'is' if len(names) == 1 else 'are'}"

    def _cut(self, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """Removes corners that are not needed: connects each one to the last visible one."""
        kept = [points[0]]
        i = 0
        while i < len(points) - 1:
            j = len(points) - 1
            while j > i + 1 and not self._sees(points[i], points[j]):
                j -= 1
            kept.append(points[j])
            i = j
        return kept

    def _sees(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether the straight line between two points is free."""
        n = max(2, math.ceil(math.dist(a, b) / (self._cell / 2)) + 1)
        x, y = np.linspace(a[0], b[0], n), np.linspace(a[1], b[1], n)
        return all(float(o.distance(x, y).min()) > self._radius - _CUT for o in self._obstacles)

    def _square(self, pose: Pose2D) -> tuple[int, int]:
        return round((pose.y - self._y0) / self._cell), round((pose.x - self._x0) / self._cell)

    def _point(self, square: tuple[int, int]) -> tuple[float, float]:
        return self._x0 + square[1] * self._cell, self._y0 + square[0] * self._cell


_STEPS = tuple((dr, dc, math.hypot(dr, dc)) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0))


def _hit(outline: tuple[Array, Array], obstacles: Sequence[Obstacle], poses: Sequence[Pose2D]) -> str | None:
    """Returns the id of the first obstacle that the base's rectangle touches in one of the poses."""
    at = np.array(poses)
    c, s = np.cos(at[:, 2])[:, None], np.sin(at[:, 2])[:, None]
    x = at[:, 0][:, None] + c * outline[0] - s * outline[1]
    y = at[:, 1][:, None] + s * outline[0] + c * outline[1]
    first: tuple[int, str] | None = None
    for obstacle in obstacles:
        touched = np.flatnonzero((obstacle.distance(x, y) < _TIGHT).any(axis=1))
        if len(touched) and (first is None or touched[0] < first[0]):
            first = int(touched[0]), obstacle.id
    return first[1] if first else None


def _is_near(obstacle: Obstacle, start: Pose2D, goal: Pose2D) -> bool:
    """Whether an obstacle may affect the path: not if it is farther away than the path's length plus 10 m."""
    reach = math.hypot(goal.x - start.x, goal.y - start.y) + 10.0
    return math.hypot(obstacle.x - start.x, obstacle.y - start.y) < reach


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
