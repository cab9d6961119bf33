"""Contacts between bodies, and those of a part of a robot, which explain why a motion is blocked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from skiros2_std_reasoners.core.geometry import Vector

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
