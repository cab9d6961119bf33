"""Disturbances of the simulated world: external forces for a limited time."""

from __future__ import annotations

from dataclasses import dataclass

from skiros2_motion.core.geometry import Vector
from skiros2_sim.core.physics import Part, Physics


@dataclass
class _Push:
    part: Part
    force: Vector
    torque: Vector
    steps: int


class Pushes:
    """The active pushes."""

    def __init__(self, physics: Physics) -> None:
        self._physics = physics
        self._active: list[_Push] = []

    def add(self, part: Part, force: Vector, torque: Vector, steps: int) -> None:
        """Applies a force (N) and a torque (Nm), in the map, at the centre of a link for a number of steps."""
        self._active.append(_Push(part, force, torque, steps))

    def remove(self, body: int) -> None:
        """Removes all pushes of a body."""
        self._active = [push for push in self._active if push.part.body != body]

    def update(self) -> None:
        """Applies the forces for the next step."""
        for push in self._active:
            self._physics.push(push.part, push.force, push.torque)
            push.steps -= 1
        self._active = [push for push in self._active if push.steps > 0]
