"""Overlaps of bodies at the start, which the engine would eject."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from skiros2_motion.core.geometry import Pose, Vector
from skiros2_sim.core.body import Body
from skiros2_sim.core.physics import Physics
from skiros2_sim.core.scene_spec import Problem

#: Largest depth (m) that the engine resolves gently by itself.
_SHALLOW = 0.002
_ROUNDS = 30


def separate_overlaps(physics: Physics, bodies: Mapping[str, Body], name_of: Callable[[int], str]) -> list[Problem]:
    """Moves movable bodies out of each other and out of fixed ones; the engine would eject them.

    :param bodies: by name.
    :param name_of: returns the name of a body or robot.
    :return: each overlap with its depth and whether it was resolved.
    """
    deepest: dict[tuple[str, str], float] = {}
    for _ in range(_ROUNDS):
        found = _overlaps(physics, name_of)
        if not found:
            break
        for pair, depth, _ in found:
            deepest[pair] = max(depth, deepest.get(pair, 0.0))
        moved = False
        for (one, other), depth, normal in found:
            back = (-normal[0], -normal[1], -normal[2])
            moved |= _shift(bodies.get(one), normal, depth) or _shift(bodies.get(other), back, depth)
        if not moved:
            break
    left = {pair for pair, _, _ in _overlaps(physics, name_of)}
    return [
        Problem(one, f"it is {depth:.3f} m inside {other}; {'not resolved' if (one, other) in left else 'moved apart'}")
        for (one, other), depth in sorted(deepest.items())
    ]


def _overlaps(physics: Physics, name_of: Callable[[int], str]) -> list[tuple[tuple[str, str], float, Vector]]:
    """Returns the deepest overlap per pair: names, depth (m) and the direction that separates the first body."""
    physics.detect_contacts()
    found: dict[tuple[str, str], tuple[float, Vector]] = {}
    for point in physics.contacts():
        one, other, normal = name_of(point.body), name_of(point.other_body), point.normal
        if one > other:
            one, other, normal = other, one, (-normal[0], -normal[1], -normal[2])
        depth = -point.distance
        if depth > _SHALLOW and depth > found.get((one, other), (0.0,))[0]:
            found[one, other] = (depth, normal)
    return [(pair, *found[pair]) for pair in sorted(found)]


def _shift(body: Body | None, way: Vector, far: float) -> bool:
    """Moves a body, if it is movable."""
    if body is None or not body.movable:
        return False
    pose = body.pose()
    x, y, z = (at + step * far for at, step in zip(pose.position, way, strict=True))
    body.place(Pose((x, y, z), pose.orientation))
    return True
