"""Contacts of a part of a robot, to explain why a motion is blocked."""

from __future__ import annotations

from skiros2_sim.core.world import World

#: Minimum force (N) of a reported contact.
_LEAST = 0.5


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


def new_contacts(world: World, part: str, before: dict[str, float]) -> dict[str, float]:
    """Returns the contacts that were not there `before`: force (N) by name, the strongest first."""
    now = contacts_of_part(world, part)
    new = [name for name in now if name not in before and now[name] >= _LEAST]
    return {name: now[name] for name in sorted(new, key=lambda name: -now[name])}


def format_contacts(new: dict[str, float]) -> str:
    """Formats contacts as ", it touches ..."; "" without contacts."""
    if not new:
        return ""
    return ", it touches " + " and ".join(f"{name} ({force:.0f} N)" for name, force in new.items())
