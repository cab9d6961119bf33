"""Contacts between bodies, one per pair."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from skiros2_motion.core.geometry import Vector
from skiros2_sim.core.physics import ContactPoint


class Contact(NamedTuple):
    """Contact of two bodies, named by the id of the element, or robot/link.

    :param position: of the centre of contact, in the map.
    :param force: normal force (N).
    """

    first: str
    second: str
    position: Vector
    force: float


def joined_contacts(points: Iterable[ContactPoint], name_of: Callable[[int, int], str]) -> list[Contact]:
    """Returns one contact per pair of bodies, ordered by name.

    :param name_of: returns the name of a body and link.
    """
    pairs: dict[tuple[str, str], list[tuple[Vector, float]]] = {}
    for point in points:
        one, other = name_of(point.body, point.link), name_of(point.other_body, point.other_link)
        if point.force > 0 or point.distance <= 0:
            pairs.setdefault((min(one, other), max(one, other)), []).append((point.position, point.force))
    return [_joined(pair, pairs[pair]) for pair in sorted(pairs)]


def _joined(pair: tuple[str, str], points: list[tuple[Vector, float]]) -> Contact:
    """Merges contact points of a pair: the centre weighted by force."""
    total = sum(force for _, force in points)
    weights = [force / total if total > 0 else 1 / len(points) for _, force in points]
    x, y, z = (sum(w * at[i] for w, (at, _) in zip(weights, points, strict=True)) for i in range(3))
    return Contact(*pair, (x, y, z), total)
