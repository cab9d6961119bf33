"""Plans a path for a mobile base around obstacles on the floor.

The base is a rectangle that turns in place and drives forward or backward. Between two poses it is planned as its
circumscribed circle, so that it can turn everywhere. Near start and goal, where it stands at a workstation, it is
planned as the rectangle and drives straight in and out.

A path is planned in pieces (`computation`). The longest piece is SciPy's search in the grid map: 13 ms for the largest
map, of 12.5 m, where a search in Python would take 0.4 s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from skiros2_common.core.errors import Refused
from skiros2_sim.core.computation import Pieces, complete

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.integer]

#: Cell size of the grid map (m), and its border around the relevant area (m).
_CELL = 0.05
_AROUND = 2.0
#: Maximum number of cells per side; larger maps have larger cells.
_MAX_CELLS = 250
#: Maximum length of a straight exit from a narrow pose (m).
_WAY_OUT = 2.0
#: Clearance to obstacles on the path (m), and in narrow poses.
_MARGIN = 0.05
_TIGHT = 0.01
#: Number of rows of the grid map in one piece of the search.
_ROWS = 25
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
        grid = _Grid(self._obstacles, out.pose, into.pose, self._free_radius)
        points = yield from grid.search(out.pose, into.pose)
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
            yield
        blocking = blocking or self._near(pose.x, pose.y)
        raise Refused(f"no way out of the {what}: {blocking!r} is in the way")

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
        self._blocked = np.zeros((self._rows, self._columns), dtype=bool)
        self._obstacles, self._radius = tuple(obstacles), radius

    def search(self, start: Pose2D, goal: Pose2D) -> Pieces[list[tuple[float, float]]]:
        """Returns the corners of the shortest path of the circle, without the start.

        :raises Refused: there is none.
        """
        for obstacle in self._obstacles:
            self._block(obstacle)
            yield
        first, last = self._square(start), self._square(goal)
        for square in (first, last):
            # the pose is free, its cell may not be
            self._blocked[square] = False
        if self._sees((start.x, start.y), (goal.x, goal.y)):
            return [(goal.x, goal.y)]
        graph = yield from self._graph()
        source, target = self._node(first), self._node(last)
        lengths, before = dijkstra(graph, indices=source, return_predecessors=True)
        yield
        if not math.isfinite(lengths[target]):
            reached = np.flatnonzero(np.isfinite(lengths))
            raise Refused(f"no path to the goal: {self._enclosing(reached, goal)} in the way")
        nodes = [target]
        while nodes[-1] != source:
            nodes.append(int(before[nodes[-1]]))
        corners = [a for a, b, c in zip(nodes[1:], nodes, nodes[2:], strict=False) if a - b != c - a]
        xs, ys = self._points(np.array([source, *corners[::-1], target]))
        points = list(zip(xs.tolist(), ys.tolist(), strict=True))
        points[0], points[-1] = (start.x, start.y), (goal.x, goal.y)
        return (yield from self._cut(points))

    def _block(self, obstacle: Obstacle) -> None:
        """Marks the cells near an obstacle."""
        # no obstacle fits between neighbouring free cells: coarse maps need more clearance
        cell, clearance = self._cell, self._radius + self._cell - _CELL
        reach = math.hypot(obstacle.half_x, obstacle.half_y) + clearance
        rows, columns = (
            slice(max(0, math.floor((at - reach - low) / cell)), max(0, math.ceil((at + reach - low) / cell) + 1))
            for at, low in ((obstacle.y, self._y0), (obstacle.x, self._x0))
        )
        x = self._x0 + np.arange(self._columns, dtype=np.float64)[None, columns] * cell
        y = self._y0 + np.arange(self._rows, dtype=np.float64)[rows, None] * cell
        self._blocked[rows, columns] |= obstacle.distance(x, y) < clearance

    def _graph(self) -> Pieces[csr_array]:
        """Returns the steps between free cells as a graph, in pieces of some rows. A border of blocked cells makes all
        neighbours exist."""
        free = np.pad(~self._blocked, ((1, 2), (1, 1))).ravel()
        width = self._columns + 2
        ways = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0)]
        offsets = np.array([dr * width + dc for dr, dc in ways])
        lengths = np.array([math.hypot(*way) for way in ways])
        counts = [np.zeros(width + 1, dtype=np.int64)]
        neighbours, weights = [], []
        for row in range(1, self._rows + 1, _ROWS):
            nodes = np.arange(row * width, min(row + _ROWS, self._rows + 1) * width)
            around = nodes[:, None] + offsets
            are_steps = free[nodes, None] & free[around]
            counts.append(are_steps.sum(axis=1))
            neighbours.append(around[are_steps])
            weights.append(np.broadcast_to(lengths, around.shape)[are_steps])
            yield
        counts.append(np.zeros(2 * width, dtype=np.int64))
        ends = np.cumsum(np.concatenate(counts))
        return csr_array((np.concatenate(weights), np.concatenate(neighbours), ends), shape=(len(free), len(free)))

    def _enclosing(self, seen: Indices, goal: Pose2D) -> str:
        """Names the obstacles around the reachable cells, the nearest to the goal first."""
        x, y = self._points(seen)
        reach = self._radius + 2 * self._cell
        around = [o for o in self._obstacles if o.distance(x, y).min() < reach]
        at = np.array([goal.x]), np.array([goal.y])
        names = [repr(o.id) for o in sorted(around, key=lambda o: float(o.distance(*at)[0]))]
        rest = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return f"{', '.join(names[:3])}{rest} {'is' if len(names) == 1 else 'are'}"

    def _cut(self, points: list[tuple[float, float]]) -> Pieces[list[tuple[float, float]]]:
        """Removes corners that are not needed: connects each one to the last visible one. Returns all but the first."""
        kept = [points[0]]
        i = 0
        while i < len(points) - 1:
            j = len(points) - 1
            while j > i + 1 and not self._sees(points[i], points[j]):
                j -= 1
                yield
            kept.append(points[j])
            i = j
        return kept[1:]

    def _sees(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Whether the straight line between two points is free."""
        n = max(2, math.ceil(math.dist(a, b) / (self._cell / 2)) + 1)
        x, y = np.linspace(a[0], b[0], n), np.linspace(a[1], b[1], n)
        return all(float(o.distance(x, y).min()) > self._radius - _CUT for o in self._obstacles)

    def _square(self, pose: Pose2D) -> tuple[int, int]:
        return round((pose.y - self._y0) / self._cell), round((pose.x - self._x0) / self._cell)

    def _node(self, square: tuple[int, int]) -> int:
        """Returns the index of a cell in the graph."""
        return (square[0] + 1) * (self._columns + 2) + square[1] + 1

    def _points(self, nodes: Indices) -> tuple[Array, Array]:
        """Returns the positions of cells, by their indices in the graph."""
        rows, columns = np.divmod(nodes, self._columns + 2)
        return self._x0 + (columns - 1) * self._cell, self._y0 + (rows - 1) * self._cell


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
