"""A box with round bores, made of boxes.

PyBullet has no concave shapes that move, and meshes collide with a margin of 1 mm; boxes are exact. A bore is a ring of
flat sides around its circle, so that a cylinder with a clearance of 0.1 mm fits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.bore import Bore
from skiros2_motion.core.geometry import Quaternion, Vector, from_euler, multiplied

#: Number of flat sides of a bore.
SIDES = 16
#: Minimum thickness of the material around a bore, as a part of its radius.
_MIN_WALL = 0.2
#: Width and height of the box below a bevel, relative to the chamfer.
_BEVEL = 1.5


class BoxShape(NamedTuple):
    """A box in the frame of its body: half of its edges (m), position of its centre (m), orientation."""

    half_edges: Vector
    position: Vector
    orientation: Quaternion


def bored_box(size: Vector, bores: Sequence[Bore]) -> list[BoxShape]:
    """Returns the boxes that fill a box except for its bores. The frame is in its centre, z up.

    :param size: edges of the box (m).
    :raises WrongValue: a bore is invalid, not inside of the box, or too near to another one; the text lists all
        problems.
    """
    cells = [_cell(size, bore, [other for other in bores if other is not bore]) for bore in bores]
    problems = [text for bore, cell in zip(bores, cells, strict=True) if (text := _problem(size, bore, cell))]
    if problems:
        raise WrongValue("; ".join(problems))
    # one plate below all bores: the box stands on few points of contact, which cost the engine less
    floors = [max(0.0, size[2] - bore.depth) for bore in bores]
    plate = min(floors, default=0.0)
    shapes = [_upright((size[0] / 2, size[1] / 2, plate / 2), (0.0, 0.0, (plate - size[2]) / 2))] if plate else []
    shapes += _around(size, list(zip(bores, cells, strict=True)), plate)
    for bore, cell, floor in zip(bores, cells, floors, strict=True):
        shapes += _ring(size, bore, cell)
        if floor > plate:
            half_edges = (cell, cell, (floor - plate) / 2)
            shapes.append(_upright(half_edges, (bore.x, bore.y, (floor + plate - size[2]) / 2)))
    return shapes


def _cell(size: Vector, bore: Bore, others: Sequence[Bore]) -> float:
    """Returns half the edge of the square around a bore that its ring fills."""
    space = [size[0] / 2 - abs(bore.x), size[1] / 2 - abs(bore.y)]
    space += [max(abs(bore.x - other.x), abs(bore.y - other.y)) / 2 for other in others]
    return min(space)


def _problem(size: Vector, bore: Bore, cell: float) -> str:
    numbers = (bore.x, bore.y, bore.diameter, bore.depth, bore.chamfer)
    where = f"bore at ({bore.x:g}, {bore.y:g})"
    if not all(map(math.isfinite, numbers)) or bore.diameter <= 0.0 or bore.depth <= 0.0 or bore.chamfer < 0.0:
        return f"{where}: expected a diameter and a depth above 0, and a chamfer of 0 or more, got {bore}"
    deepest = min(bore.depth, size[2]) / _BEVEL
    if bore.chamfer >= deepest:
        return f"{where}: chamfer {bore.chamfer:g} m: expected less than {deepest:g} m, two thirds of its depth"
    widest = 2 * max(0.0, min(cell / (1.0 + _MIN_WALL) - bore.chamfer, cell - _BEVEL * bore.chamfer))
    if bore.diameter > widest:
        return f"{where}: diameter {bore.diameter:g} m: expected up to {widest:.4f} m between its neighbours"
    return ""


def _around(size: Vector, cells: Sequence[tuple[Bore, float]], plate: float) -> list[BoxShape]:
    """Returns boxes between the cells, above the plate: a grid along their edges."""
    xs = sorted({-size[0] / 2, size[0] / 2, *(bore.x + s * cell for bore, cell in cells for s in (-1, 1))})
    ys = sorted({-size[1] / 2, size[1] / 2, *(bore.y + s * cell for bore, cell in cells for s in (-1, 1))})
    found = []
    for (x0, x1), (y0, y1) in itertools.product(itertools.pairwise(xs), itertools.pairwise(ys)):
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        if any(abs(x - bore.x) < cell and abs(y - bore.y) < cell for bore, cell in cells):
            continue
        if x1 - x0 > 1e-6 and y1 - y0 > 1e-6:
            found.append(_upright(((x1 - x0) / 2, (y1 - y0) / 2, (size[2] - plate) / 2), (x, y, plate / 2)))
    return found


def _ring(size: Vector, bore: Bore, cell: float) -> list[BoxShape]:
    """Returns the boxes of a ring: the wall below the chamfer, the material outside of it, and the bevels."""
    depth, chamfer, radius = min(bore.depth, size[2]), bore.chamfer, bore.diameter / 2
    top, half_angle = size[2] / 2, math.pi / SIDES
    # The corners of the walls stick out of the square that the walls fill, by up to this factor (those at 45 degrees).
    square = cell / (1.0 + math.tan(half_angle))
    found = _frame(bore, (square, cell), (top - depth, top))
    for side in range(SIDES):
        angle = 2 * half_angle * side
        # the farthest point of the square in this sector, along its axis
        sector = [part * half_angle for part in (-1, -0.5, 0, 0.5, 1)]
        outer = max(_reach(square, angle + off) * math.cos(off) for off in sector)
        found.append(_wall(bore, angle, (radius, outer), (top - depth, top - chamfer)))
        if chamfer > 0.0:
            found.append(_wall(bore, angle, (radius + chamfer, outer), (top - chamfer, top)))
            found.append(_bevel(bore, top, angle))
    return found


def _frame(bore: Bore, squares: tuple[float, float], heights: tuple[float, float]) -> list[BoxShape]:
    """Returns the four boxes between two squares around a bore (halves of their edges) and two heights."""
    (inner, outer), (low, high) = squares, heights
    middle, half, height = (inner + outer) / 2, (outer - inner) / 2, (high - low) / 2
    sides = [((half, outer, height), (side * middle, 0.0)) for side in (-1, 1)]
    sides += [((inner, half, height), (0.0, side * middle)) for side in (-1, 1)]
    return [_upright(edges, (bore.x + x, bore.y + y, low + height)) for edges, (x, y) in sides]


def _wall(bore: Bore, angle: float, radii: tuple[float, float], heights: tuple[float, float]) -> BoxShape:
    """Returns the box of one side between two radii and two heights, wide enough to meet its neighbours."""
    (inner, outer), (low, high) = radii, heights
    middle = (inner + outer) / 2
    position = (bore.x + middle * math.cos(angle), bore.y + middle * math.sin(angle), (low + high) / 2)
    half_edges = ((outer - inner) / 2, outer * math.tan(math.pi / SIDES), (high - low) / 2)
    return BoxShape(half_edges, position, from_euler(0.0, 0.0, angle))


def _bevel(bore: Bore, top: float, angle: float) -> BoxShape:
    """Returns the box whose upper face is the bevel of one side."""
    chamfer = bore.chamfer
    length, thickness = chamfer * math.sqrt(2.0), chamfer / math.sqrt(2.0)
    # the middle of the face, moved into the material along the face's normal
    out = bore.diameter / 2 + chamfer / 2 + thickness / 2 / math.sqrt(2.0)
    down = chamfer / 2 + thickness / 2 / math.sqrt(2.0)
    turned = multiplied(from_euler(0.0, 0.0, angle), from_euler(0.0, -math.pi / 4, 0.0))
    position = (bore.x + out * math.cos(angle), bore.y + out * math.sin(angle), top - down)
    width = (bore.diameter / 2 + chamfer) * math.tan(math.pi / SIDES)
    return BoxShape((length / 2, width, thickness / 2), position, turned)


def _reach(cell: float, angle: float) -> float:
    """Returns the distance from the centre of a square to its edge."""
    return cell / max(abs(math.cos(angle)), abs(math.sin(angle)))


def _upright(half_edges: Vector, position: Vector) -> BoxShape:
    return BoxShape(half_edges, position, (0.0, 0.0, 0.0, 1.0))
