"""Forces that push bodies for some time."""

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
    """The pushes that go on."""

    def __init__(self, bullet: Bullet) -> None:
        self._bullet = bullet
        self._going: list[_Push] = []

    def add(self, body: int, link: int, force: Vector, torque: Vector, steps: int) -> None:
        """Pushes at the middle of a link for so many steps, with a force (N) and a torque (Nm) in the map."""
        self._going.append(_Push(body, link, force, torque, steps))

    def forget(self, body: int) -> None:
        """Pushes a body no longer."""
        self._going = [push for push in self._going if push.body != body]

    def update(self) -> None:
        """Pushes in the next step."""
        bullet = self._bullet
        for push in self._going:
            if push.link < 0:
                at = bullet.getBasePositionAndOrientation(push.body)[0]
            else:
                at = bullet.getLinkState(push.body, push.link)[0]
            bullet.applyExternalForce(push.body, push.link, push.force, at, bullet.WORLD_FRAME)
            bullet.applyExternalTorque(push.body, push.link, push.torque, bullet.WORLD_FRAME)
            push.steps -= 1
        self._going = [push for push in self._going if push.steps > 0]
