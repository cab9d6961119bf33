"""External forces on bodies for a limited time."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_sim.core.bullet import Bullet
from skiros2_std_reasoners.core.geometry import Vector


@dataclass
class _Push:
    body: int
    link: int
    force: Vector
    torque: Vector
    steps: int


class Pushes:
    """The active pushes."""

    def __init__(self, bullet: Bullet) -> None:
        self._bullet = bullet
        self._active: list[_Push] = []

    def add(self, body: int, link: int, force: Vector, torque: Vector, steps: int) -> None:
        """Applies a force (N) and a torque (Nm), in the map, at the centre of a link for a number of steps."""
        self._active.append(_Push(body, link, force, torque, steps))

    def remove(self, body: int) -> None:
        """Removes all pushes of a body."""
        self._active = [push for push in self._active if push.body != body]

    def update(self) -> None:
        """Applies the forces for the next step."""
        bullet = self._bullet
        for push in self._active:
            if push.link < 0:
                at = bullet.getBasePositionAndOrientation(push.body)[0]
            else:
                at = bullet.getLinkState(push.body, push.link)[0]
            bullet.applyExternalForce(push.body, push.link, push.force, at, bullet.WORLD_FRAME)
            bullet.applyExternalTorque(push.body, push.link, push.torque, bullet.WORLD_FRAME)
            push.steps -= 1
        self._active = [push for push in self._active if push.steps > 0]
