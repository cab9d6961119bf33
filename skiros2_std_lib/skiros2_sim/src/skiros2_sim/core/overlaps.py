"""Resolves overlaps between bodies before the first step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skiros2_sim.core.scene_spec import Problem
from skiros2_std_reasoners.core.geometry import Pose

if TYPE_CHECKING:
    from skiros2_sim.core.world import World

#: Largest depth (m) that the engine resolves gently by itself.
_SHALLOW = 0.002
_ROUNDS = 30


def separate_overlaps(world: World) -> list[Problem]:
    """Moves movable bodies out of each other and out of fixed ones; the engine would eject them.

    :return: each overlap with its depth and whether it was resolved.
    """
    deepest: dict[tuple[str, str], float] = {}
    for _ in range(_ROUNDS):
        found = _overlaps(world)
        if not found:
            break
        for pair, depth, _ in found:
            deepest[pair] = max(depth, deepest.get(pair, 0.0))
        moved = False
        for (one, other), depth, normal in found:
            moved |= _shift(world, one, normal, depth) or _shift(
                world, other, (-normal[0], -normal[1], -normal[2]), depth
            )
        if not moved:
            break
    left = {pair for pair, _, _ in _overlaps(world)}
    return [
        Problem(one, f"it is {depth:.3f} m inside {other}; {'not resolved' if (one, other) in left else 'moved apart'}")
        for (one, other), depth in sorted(deepest.items())
    ]


def _overlaps(world: World) -> list[tuple[tuple[str, str], float, tuple[float, float, float]]]:
    """Returns the deepest overlap per pair: names, depth (m) and the direction that separates the first body."""
    world.bullet.performCollisionDetection()
    found: dict[tuple[str, str], tuple[float, tuple[float, float, float]]] = {}
    for point in world.bullet.getContactPoints():
        one, other = world.name_of(point[1]), world.name_of(point[2])
        one, other = (world.element_of(point[1]) or one), (world.element_of(point[2]) or other)
        normal = point[7]
        if one > other:
            one, other, normal = other, one, (-normal[0], -normal[1], -normal[2])
        depth = -point[8]
        if depth > _SHALLOW and depth > found.get((one, other), (0.0,))[0]:
            found[one, other] = (depth, normal)
    return [(pair, *found[pair]) for pair in sorted(found)]


def _shift(world: World, eid: str, way: tuple[float, float, float], far: float) -> bool:
    """Moves a body, if it is movable."""
    body = world.bodies.get(eid)
    if body is None or not body.movable:
        return False
    pose = body.pose()
    x, y, z = (at + step * far for at, step in zip(pose.position, way, strict=True))
    body.place(Pose((x, y, z), pose.orientation))
    return True
