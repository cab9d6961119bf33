"""Contacts between bodies: of a part of a robot, which explain why a motion is blocked, and overlaps at the start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from skiros2_motion.core.geometry import Pose, Vector
from skiros2_sim.core.scene_spec import Problem

if TYPE_CHECKING:
    from skiros2_sim.core.world import World

#: Minimum force (N) of a reported contact.
_LEAST = 0.5


class Contact(NamedTuple):
    """Contact of two bodies, named by the id of the element, or robot/link.

    :param position: of the centre of contact, in the map.
    :param force: normal force (N).
    """

    first: str
    second: str
    position: Vector
    force: float


def joined_contacts(points: Iterable[Sequence[Any]], name_of: Callable[[int, int], str]) -> list[Contact]:
    """Returns one contact per pair of bodies, ordered by name.

    :param points: the result of PyBullet's `getContactPoints`.
    :param name_of: returns the name of a body and link.
    """
    pairs: dict[tuple[str, str], list[tuple[Vector, float]]] = {}
    for point in points:
        one, other = name_of(point[1], point[3]), name_of(point[2], point[4])
        if point[9] > 0 or point[8] <= 0:
            pairs.setdefault((min(one, other), max(one, other)), []).append((point[5], point[9]))
    return [_joined(pair, pairs[pair]) for pair in sorted(pairs)]


def _joined(pair: tuple[str, str], points: list[tuple[Vector, float]]) -> Contact:
    """Merges contact points of a pair: the centre weighted by force."""
    total = sum(force for _, force in points)
    weights = [force / total if total > 0 else 1 / len(points) for _, force in points]
    x, y, z = (sum(w * at[i] for w, (at, _) in zip(weights, points, strict=True)) for i in range(3))
    return Contact(*pair, (x, y, z), total)


class PartContacts:
    """The contacts of a part of a robot since a time, with the movable bodies that it carries.

    :param part: name prefix of the links: ROBOT/ for the whole robot, or ROBOT/ARM/. Contacts within it are ignored.
    """

    def __init__(self, world: World, part: str) -> None:
        self._world = world
        self._part = part
        self.restart()

    def restart(self) -> None:
        """Sets the time to now."""
        self._known = contacts_of_part(self._world, self._part)

    def new(self) -> dict[str, float]:
        """Returns the contacts that were not there at that time: force (N) by name, the strongest first."""
        now = contacts_of_part(self._world, self._part)
        new = [name for name in now if name not in self._known and now[name] >= _LEAST]
        return {name: now[name] for name in sorted(new, key=lambda name: -now[name])}

    def describe(self) -> str:
        """Returns the new contacts as ", it touches ..."; "" without contacts."""
        return format_contacts(self.new())


def contacts_of_part(world: World, part: str) -> dict[str, float]:
    """Returns the bodies in contact with a part of a robot or with movable bodies it carries: force (N) by name.

    :param part: name prefix of the links: ROBOT/ for the whole robot, or ROBOT/ARM/. Contacts within it are ignored.
    """
    contacts = world.contacts()
    touching: dict[str, float] = {}
    for contact in contacts:
        for one, other in ((contact.first, contact.second), (contact.second, contact.first)):
            if one.startswith(part) and not other.startswith(part):
                touching[other] = touching.get(other, 0.0) + contact.force
    carried = {name for name in touching if name in world.bodies and world.bodies[name].movable}
    for contact in contacts:
        for one, other in ((contact.first, contact.second), (contact.second, contact.first)):
            if one in carried and not other.startswith(part):
                touching[other] = touching.get(other, 0.0) + contact.force
    return touching


def format_contacts(new: dict[str, float]) -> str:
    """Formats contacts as ", it touches ..."; "" without contacts."""
    if not new:
        return ""
    return ", it touches " + " and ".join(f"{name} ({force:.0f} N)" for name, force in new.items())


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
