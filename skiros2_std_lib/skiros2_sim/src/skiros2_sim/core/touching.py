"""What a moving part of a robot touches, in words for the reason why it did not get on."""

from __future__ import annotations

from skiros2_sim.core.world import World

#: Contacts with less force (N) are no reason.
_LEAST = 0.5


def touched(world: World, part: str) -> dict[str, float]:
    """What the links whose names begin with `part` touch, and what things that they carry touch: the force (N) by name.

    :param part: ROBOT/ for all of it, or ROBOT/ARM/. Its links do not count as touched.
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


def new_touches(world: World, part: str, before: dict[str, float]) -> dict[str, float]:
    """What is touched now and was not `before`: the force (N) by name, the strongest first."""
    now = touched(world, part)
    new = [name for name in now if name not in before and now[name] >= _LEAST]
    return {name: now[name] for name in sorted(new, key=lambda name: -now[name])}


def because(new: dict[str, float]) -> str:
    """ ", it touches ..." for such; "" when there are none."""
    if not new:
        return ""
    return ", it touches " + " and ".join(f"{name} ({force:.0f} N)" for name, force in new.items())
