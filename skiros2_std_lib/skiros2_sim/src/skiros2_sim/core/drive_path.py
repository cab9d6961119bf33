"""A way for a mobile base past what stands on the floor.

The base is a rectangle that turns on the spot and drives forward or backward. On the way between two places it is
taken as the circle around that rectangle, so it may turn everywhere. Near its start and its goal, where it stands at a
workstation, it is taken as the rectangle itself and drives straight in and out.
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

#: Edge of a square of the map that ways are looked for in (m), and how far it goes beyond what matters (m).
_CELL = 0.05
_AROUND = 2.0
#: No map has more squares along one side; they become larger instead.
_MOST_CELLS = 400
#: How far the base drives straight out of a narrow place, at most (m).
_WAY_OUT = 2.0
#: Room that is kept to obstacles on the way, beside the base's own size (m), and where it only just has to fit.
_MARGIN = 0.05
_TIGHT = 0.01
#: How much of that room a straight line between squares may take (m).
_CUT = 0.04


class Place(NamedTuple):
    """Where the base stands on the floor: m, and the way it looks (rad)."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Obstacle:
    """Something on the floor: a rectangle around (x, y), turned by yaw; half its edges in m."""

    id: str
    x: float
    y: float
    yaw: float
    half_x: float
    half_y: float

    def distance(self, x: Array, y: Array) -> Array:
        """How far points are from its edge (m); 0 inside."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        dx, dy = x - self.x, y - self.y
        outside_x = np.maximum(np.abs(c * dx + s * dy) - self.half_x, 0.0)
        outside_y = np.maximum(np.abs(c * dy - s * dx) - self.half_y, 0.0)
        distance: Array = np.hypot(outside_x, outside_y)
        return distance


@dataclass(frozen=True)
class Footprint:
    """The base's rectangle: m before, behind and beside its frame's origin."""

    front: float
    back: float
    side: float

    @property
    def radius(self) -> float:
        """Of the circle around its origin that holds it."""
        return math.hypot(max(self.front, self.back), self.side)

    def outline(self) -> tuple[Array, Array]:
        """Points of it, at most 5 cm from one another, in the base's frame."""
        xs = np.linspace(-self.back, self.front, max(2, math.ceil((self.front + self.back) / 0.05) + 1))
        ys = np.linspace(-self.side, self.side, max(2, math.ceil(2 * self.side / 0.05) + 1))
        x, y = np.meshgrid(xs, ys)
        return x.ravel(), y.ravel()


class Leg(NamedTuple):
    """A straight piece of a way: to the place, after a turn to the way it goes; `backward`: with the rear ahead."""

    x: float
    y: float
    backward: bool


class Floor:
    """What stands around a base that has to get somewhere."""

    def __init__(self, footprint: Footprint, obstacles: Sequence[Obstacle]) -> None:
        self._outline = footprint.outline()
        self._obstacles = tuple(obstacles)
        self._free_radius = footprint.radius + _MARGIN

    def in_the_way(self, place: Place) -> str | None:
        """The id of what the base would stand in there."""
        return _hit(self._outline, self._obstacles, [place])

    def first_hit(self, start: Place, legs: Sequence[Leg], ahead: float) -> str | None:
        """The id of what the next `ahead` metres of the way lead into; what it stands in already it may leave."""
        others = self._not_touched(start)
        here = start
        for leg in legs:
            length = math.hypot(leg.x - here.x, leg.y - here.y)
            if length > 1e-6:
                part = min(1.0, ahead / length)
                end = Place(here.x + part * (leg.x - here.x), here.y + part * (leg.y - here.y), heading(here, leg))
                hit = _hit(self._outline, others, _between(Place(here.x, here.y, end.yaw), end))
                if hit is not None:
                    return hit
                here = Place(leg.x, leg.y, end.yaw)
            ahead -= length
            if ahead <= 0.0:
                break
        return None

    def way(self, start: Place, goal: Place) -> list[Leg]:
        """The legs from one place to the other; the turn to the goal's yaw comes after the last one. Raises Refused
        with the id of what is in the way."""
        hit = self.in_the_way(goal)
        if hit is not None:
            raise Refused(f"the goal is inside {hit!r}")
        direct = self._direct(start, goal)
        if direct is not None:
            return direct
        out = self._way_out(start, "start")
        into = self._way_out(goal, "goal")
        # out of the start, on to the last place before the goal, and into the goal the way that leads out, turned round
        points = self._search(out.place, into.place)
        legs = [Leg(out.place.x, out.place.y, out.backward)] if out.length else []
        legs += [Leg(x, y, False) for x, y in points]
        if into.length:
            legs.append(Leg(goal.x, goal.y, not into.backward))
        return legs

    def _direct(self, start: Place, goal: Place) -> list[Leg] | None:
        """One straight leg, forward or backward, when nothing is near it. Backward only on short ways."""
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
                turned = Place(start.x, start.y, ahead)
                arrived = Place(goal.x, goal.y, ahead)
                ways = [_turning(start, ahead), _between(turned, arrived), _turning(arrived, goal.yaw)]
                leg_list = [leg]
            if all(_hit(self._outline, self._obstacles, way) is None for way in ways):
                return leg_list
        return None

    def _way_out(self, place: Place, what: str) -> _WayOut:
        """The nearest place straight before or behind this one where the base can turn."""
        blocking = None
        others = self._not_touched(place)
        for step in range(int(_WAY_OUT / _CELL) + 1):
            for backward in (True, False):
                length = step * _CELL
                sign = -length if backward else length
                free = Place(place.x + sign * math.cos(place.yaw), place.y + sign * math.sin(place.yaw), place.yaw)
                if self._near(free.x, free.y) is not None:
                    continue
                blocking = _hit(self._outline, others, _between(place, free))
                if blocking is None:
                    return _WayOut(free, backward, length)
        blocking = blocking or self._near(place.x, place.y)
        raise Refused(f"no way out of the {what}, {blocking!r} is in the way")

    def _near(self, x: float, y: float) -> str | None:
        """The id of what is too near to turn there."""
        at = np.array([x]), np.array([y])
        for obstacle in self._obstacles:
            if obstacle.distance(*at)[0] < self._free_radius:
                return obstacle.id
        return None

    def _not_touched(self, place: Place) -> list[Obstacle]:
        """What the base does not stand in there."""
        return [obstacle for obstacle in self._obstacles if _hit(self._outline, [obstacle], [place]) is None]

    def _search(self, start: Place, goal: Place) -> list[tuple[float, float]]:
        """Corner points of the shortest way of the circle, without the start (A* on a grid, then corners cut)."""
        grid = _Grid(self._obstacles, start, goal, self._free_radius)
        return grid.search(start, goal)


class _WayOut(NamedTuple):
    place: Place
    backward: bool
    length: float


class _Grid:
    """A map of squares around start, goal and obstacles, with the distance of each to the nearest obstacle."""

    def __init__(self, obstacles: Sequence[Obstacle], start: Place, goal: Place, radius: float) -> None:
        reach = _AROUND + radius
        near = [o for o in obstacles if _is_near(o, start, goal)]
        spread = [math.hypot(o.half_x, o.half_y) for o in near]
        xs = [start.x, goal.x, *(o.x - r for o, r in zip(near, spread, strict=True))]
        xs += [o.x + r for o, r in zip(near, spread, strict=True)]
        ys = [start.y, goal.y, *(o.y - r for o, r in zip(near, spread, strict=True))]
        ys += [o.y + r for o, r in zip(near, spread, strict=True)]
        self._x0, self._y0 = min(xs) - reach, min(ys) - reach
        width, height = max(xs) + reach - self._x0, max(ys) + reach - self._y0
        self._cell = max(_CELL, width / _MOST_CELLS, height / _MOST_CELLS)
        self._columns, self._rows = math.ceil(width / self._cell) + 1, math.ceil(height / self._cell) + 1
        x = self._x0 + np.arange(self._columns)[None, :] * self._cell
        y = self._y0 + np.arange(self._rows)[:, None] * self._cell
        self._blocked = np.zeros((self._rows, self._columns), dtype=bool)
        for obstacle in obstacles:
            # from one free square to the next nothing may stand between them: coarse maps keep farther away
            self._blocked |= obstacle.distance(x, y) < radius + self._cell - _CELL
        self._obstacles, self._radius = tuple(obstacles), radius

    def search(self, start: Place, goal: Place) -> list[tuple[float, float]]:
        """The corners of a way from the start's square to the goal's place. Raises Refused when there is none."""
        first, last = self._square(start), self._square(goal)
        for square in (first, last):
            # the place itself is free, its square may not be
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
        """A* with the distance over straight and diagonal steps as the estimate."""
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
        """The ids of what stands around the squares that can be reached, the nearest to the goal first."""
        points = np.array([self._point(square) for square in seen])
        reach = self._radius + 2 * self._cell
        around = [o for o in self._obstacles if o.distance(points[:, 0], points[:, 1]).min() < reach]
        at = np.array([goal[0]]), np.array([goal[1]])
        names = [repr(o.id) for o in sorted(around, key=lambda o: float(o.distance(*at)[0]))]
        rest = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return f"{', '.join(names[:3])}{rest} {'is' if len(names) == 1 else 'are'}"

    def _cut(self, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """Only those corners that are needed: from each, on to the last one that is in sight."""
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
        """Whether the circle gets straight from one point to the other."""
        n = max(2, math.ceil(math.dist(a, b) / (self._cell / 2)) + 1)
        x, y = np.linspace(a[0], b[0], n), np.linspace(a[1], b[1], n)
        return all(float(o.distance(x, y).min()) > self._radius - _CUT for o in self._obstacles)

    def _square(self, place: Place) -> tuple[int, int]:
        return round((place.y - self._y0) / self._cell), round((place.x - self._x0) / self._cell)

    def _point(self, square: tuple[int, int]) -> tuple[float, float]:
        return self._x0 + square[1] * self._cell, self._y0 + square[0] * self._cell


_STEPS = tuple((dr, dc, math.hypot(dr, dc)) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0))


def _hit(outline: tuple[Array, Array], obstacles: Sequence[Obstacle], places: Sequence[Place]) -> str | None:
    """The id of the first obstacle that the base's rectangle touches in one of the places."""
    at = np.array(places)
    c, s = np.cos(at[:, 2])[:, None], np.sin(at[:, 2])[:, None]
    x = at[:, 0][:, None] + c * outline[0] - s * outline[1]
    y = at[:, 1][:, None] + s * outline[0] + c * outline[1]
    first: tuple[int, str] | None = None
    for obstacle in obstacles:
        touched = np.flatnonzero((obstacle.distance(x, y) < _TIGHT).any(axis=1))
        if len(touched) and (first is None or touched[0] < first[0]):
            first = int(touched[0]), obstacle.id
    return first[1] if first else None


def _is_near(obstacle: Obstacle, start: Place, goal: Place) -> bool:
    """Whether it may matter for the way: what is farther off than the way is long, and 10 m, does not."""
    reach = math.hypot(goal.x - start.x, goal.y - start.y) + 10.0
    return math.hypot(obstacle.x - start.x, obstacle.y - start.y) < reach


def heading(here: Place, leg: Leg) -> float:
    """The way the base looks on a leg."""
    yaw = math.atan2(leg.y - here.y, leg.x - here.x)
    return wrapped(yaw + math.pi) if leg.backward else yaw


def _between(a: Place, b: Place) -> list[Place]:
    """Places on the straight line, at most 4 cm apart, with the yaw of the first."""
    n = max(2, math.ceil(math.hypot(b.x - a.x, b.y - a.y) / 0.04) + 1)
    return [Place(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.yaw) for t in np.linspace(0.0, 1.0, n)]


def _turning(place: Place, yaw: float) -> list[Place]:
    """Places of a turn on the spot, at most 0.1 rad apart, the shorter way round."""
    way = wrapped(yaw - place.yaw)
    n = max(2, math.ceil(abs(way) / 0.1) + 1)
    return [Place(place.x, place.y, place.yaw + t * way) for t in np.linspace(0.0, 1.0, n)]


def wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)
