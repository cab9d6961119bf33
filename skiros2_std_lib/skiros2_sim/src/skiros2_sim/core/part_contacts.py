"""Contacts of a part of a robot, which explain why a motion is blocked."""

from __future__ import annotations

from skiros2_sim.core.world import World

#: Minimum force (N) of a reported contact.
_LEAST = 0.5


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
