"""Pictures of a run: the whole cell from outside, and what the robot sees."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

from skiros2_common.core.errors import SkirosError
from skiros2_std_reasoners.core.geometry import Vector

#: From the middle of the cell to the eye, as parts of the cell's width.
_DIRECTION = (-0.5, -0.26, 0.5)


class Photographer(Protocol):
    """Who takes pictures; see `Simulation`."""

    def take_picture(self, file: Path, eye: Vector, target: Vector) -> Path: ...

    def take_robots_picture(self, file: Path, topic: str) -> Path: ...


class Pictures:
    """Takes them once for each moment of a run, as `MOMENT_cell.png` and `MOMENT_robot.png`. One that fails is told of
    and does not end the run.

    :param places: where the things of the cell are, in the map (m).
    :param say: told of each picture, and why there is none.
    """

    def __init__(
        self, by: Photographer, folder: Path, places: Iterable[Vector], topic: str, say: Callable[[str], None]
    ) -> None:
        self._by = by
        self._folder = folder
        self._topic = topic
        self._say = say
        self._taken: set[str] = set()
        self._eye, self._target = view_of(places)

    def take(self, moment: str) -> None:
        """Takes those of a moment, if there are none yet."""
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


def view_of(places: Iterable[Vector]) -> tuple[Vector, Vector]:
    """An eye, and a target, for a picture with all these places (m)."""
    sides = [(min(axis), max(axis)) for axis in zip(*places, strict=True)]
    if not sides:
        return (-3.0, -2.0, 3.0), (0.0, 0.0, 0.0)
    width = max(high - low for low, high in sides) + 1.0
    x, y, z = ((low + high) / 2 for low, high in sides)
    dx, dy, dz = (part * width for part in _DIRECTION)
    return (x + dx, y + dy, z + dz), (x, y, z)
