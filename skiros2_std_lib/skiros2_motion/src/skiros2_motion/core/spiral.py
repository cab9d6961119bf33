"""An overlay motion: an Archimedean spiral in a plane, added to the reference of a compliant arm.

The path is `r = d / (2 pi) theta` with the distance `d` between neighbouring turns. The point moves at the path
velocity `v`: `theta' = v / r`, `r' = theta' d / (2 pi)`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skiros2_common.core.errors import WrongValue

Array = npt.NDArray[np.float64]

#: Maximum radius (m) and path velocity (m/s).
MAX_RADIUS, MAX_VELOCITY = 0.1, 0.5


@dataclass(frozen=True)
class SpiralGoal:
    """A spiral.

    :param radius: outer radius (m).
    :param path_distance: distance between neighbouring turns (m).
    :param path_velocity: m/s.
    :param direction: normal of the plane, in the frame of the reference.
    :param allow_decrease: whether the spiral turns back inwards at the outer radius, and so on until it is stopped.
        Otherwise it ends there.
    :raises WrongValue: a number is out of range; the text lists all problems.
    """

    radius: float
    path_distance: float
    path_velocity: float
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    allow_decrease: bool = False

    def __post_init__(self) -> None:
        problems = [
            f"{name} {value}: expected a number above 0, up to {most:g} {unit}"
            for name, value, most, unit in (
                ("radius", self.radius, MAX_RADIUS, "m"),
                ("path_distance", self.path_distance, MAX_RADIUS, "m"),
                ("path_velocity", self.path_velocity, MAX_VELOCITY, "m/s"),
            )
            if not (math.isfinite(value) and 0.0 < value <= most)
        ]
        length = math.hypot(*self.direction)
        if not (math.isfinite(length) and length > 1e-6):
            problems.append(f"direction {self.direction}: expected a vector with a length above 0")
        if problems:
            raise WrongValue(f"overlay motion: {'; '.join(problems)}")


class Spiral:
    """The current point of a spiral. It starts at the centre, and returns to it smoothly when it is stopped."""

    #: Velocity of the return to the centre, as a factor of the path velocity.
    _RETURN = 1.0

    def __init__(self, goal: SpiralGoal) -> None:
        self.goal = goal
        self.radius = 0.0
        self.is_stopping = False
        #: Whether the outer radius was reached.
        self.is_complete = False
        self._angle = 0.0
        self._growth = 1.0
        normal = np.array(goal.direction) / math.hypot(*goal.direction)
        # an axis that is not parallel to the normal spans the plane with it
        other = np.eye(3)[int(np.argmin(np.abs(normal)))]
        first = np.cross(other, normal)
        self._first = first / np.linalg.norm(first)
        self._second = np.cross(normal, self._first)

    @property
    def has_ended(self) -> bool:
        """Whether it has been stopped and has returned to its centre."""
        return self.is_stopping and self.radius == 0.0

    def stop(self) -> None:
        """Returns to the centre on a straight line from the next update on."""
        self.is_stopping = True

    def update(self, dt: float) -> Array:
        """Advances by `dt` seconds. Returns the offset from the centre (m)."""
        goal = self.goal
        if self.is_stopping:
            self.radius = max(0.0, self.radius - self._RETURN * goal.path_velocity * dt)
        elif not (self.is_complete and not goal.allow_decrease):
            # near the centre, where v / r is not bounded, the point moves on the first half turn
            turn = goal.path_velocity * dt / max(self.radius, goal.path_distance / 2.0)
            self._angle += turn
            self.radius += self._growth * turn * goal.path_distance / (2.0 * math.pi)
            if self.radius >= goal.radius:
                self.radius, self._growth, self.is_complete = goal.radius, -1.0, True
            elif self.radius <= 0.0:
                self.radius, self._growth = 0.0, 1.0
        point: Array = self.radius * (math.cos(self._angle) * self._first + math.sin(self._angle) * self._second)
        return point


class TimedSpiral:
    """The overlay motion of an arm whose driver has none: a spiral that follows a clock (s)."""

    def __init__(self) -> None:
        self._spiral: Spiral | None = None
        self._updated_at = 0.0

    @property
    def is_moving(self) -> bool:
        return self._spiral is not None

    def start(self, goal: SpiralGoal, now: float) -> None:
        """Starts a spiral in place of the current one."""
        self._spiral, self._updated_at = Spiral(goal), now

    def stop(self) -> None:
        """Has the spiral return to its centre."""
        if self._spiral is not None:
            self._spiral.stop()

    def clear(self) -> None:
        """Ends the spiral where it is."""
        self._spiral = None

    def offset(self, now: float) -> list[float]:
        """Returns the offset of the reference at a time (m, in its frame)."""
        if self._spiral is None:
            return [0.0, 0.0, 0.0]
        passed, self._updated_at = max(0.0, now - self._updated_at), now
        offset: list[float] = self._spiral.update(passed).tolist()
        if self._spiral.has_ended:
            self._spiral = None
        return offset
