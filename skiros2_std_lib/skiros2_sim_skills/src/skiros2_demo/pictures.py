"""Pictures of a run: an overview of the cell, and the robot's camera image."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

from skiros2_common.core.errors import SkirosError
from skiros2_std_reasoners.core.geometry import Vector

#: Direction from the centre of the cell to the camera, relative to the width of the cell.
_DIRECTION = (-0.5, -0.26, 0.5)


class PictureSource(Protocol):
    """The part of `Simulation` that takes pictures."""

    def take_picture(self, file: Path, eye: Vector, target: Vector) -> Path: ...

    def take_robots_picture(self, file: Path, topic: str) -> Path: ...


class Pictures:
    """Saves two pictures per moment of a run: `MOMENT_cell.png` and `MOMENT_robot.png`. Errors are reported, not
    raised.

    :param places: positions of the things in the cell, in the map (m).
    :param say: prints a message.
    """

    def __init__(
        self, by: PictureSource, folder: Path, places: Iterable[Vector], topic: str, say: Callable[[str], None]
    ) -> None:
        self._by = by
        self._folder = folder
        self._topic = topic
        self._say = say
        self._taken: set[str] = set()
        self._eye, self._target = camera_view(places)

    def take(self, moment: str) -> None:
        """Saves the pictures of a moment, once."""
        if moment in self._taken:
            return
        self._taken.add(moment)
        cell, robot = (self._folder / f"{moment}_{of}.png" for of in ("cell", "robot"))
        self._try(cell, lambda: self._by.take_picture(cell, self._eye, self._target))
        if self._topic:
            self._try(robot, lambda: self._by.take_robots_picture(robot, self._topic))

    def _try(self, file: Path, take: Callable[[], Path]) -> None:
        try:
            self._say(f"  picture: {take()}")
        except SkirosError as error:
            self._say(f"  no picture {file.name}: {error}")


def camera_view(places: Iterable[Vector]) -> tuple[Vector, Vector]:
    """Returns camera position and target for a picture of all positions (m)."""
    sides = [(min(axis), max(axis)) for axis in zip(*places, strict=True)]
    if not sides:
        return (-3.0, -2.0, 3.0), (0.0, 0.0, 0.0)
    width = max(high - low for low, high in sides) + 1.0
    x, y, z = ((low + high) / 2 for low, high in sides)
    dx, dy, dz = (part * width for part in _DIRECTION)
    return (x + dx, y + dy, z + dz), (x, y, z)
