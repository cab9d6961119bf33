"""Injects a fault of a sensor during a contact skill in physics, and judges what follows by the engine's truth: contact
forces and joint velocities, not the sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skiros2_sim.core.arm_controller import ArmController
from skiros2_sim.core.world import World

#: Faults by name: kind, value, and whether the sensor is noisy.
FAULTS = {
    "NaN": ("nan_sensor", 3.0, True),
    "no message": ("silent_sensor", 0.0, True),
    "late by 0.5 s": ("late_sensor", 0.5, True),
    "frozen at the last value": ("frozen_sensor", 0.0, True),
    "frozen at 0": ("zero_sensor", 0.0, True),
    "frozen at the last value, exact sensor": ("frozen_sensor", 0.0, False),
    "frozen at 0, exact sensor": ("zero_sensor", 0.0, False),
}
#: Time after a stop at which the arm rests (s), and speed of each joint then (rad/s).
REST_TIME, REST_SPEED = 0.2, 0.03
#: Time that is observed after a fault, and after a stop (s).
AFTER, AFTER_STOP = 1.5, REST_TIME + 0.3


@dataclass
class Result:
    """What followed an injected fault.

    :param peak: largest true force of the contacts with the hand since the fault (N).
    :param delay: from the fault to the stop (s); inf without one.
    :param speed: largest speed of a joint from `REST_TIME` after the stop on (rad/s).
    :param quantity: why the arm stopped.
    """

    peak: float = 0.0
    delay: float = math.inf
    speed: float = 0.0
    quantity: str = ""


class FaultWatch:
    """Starts a fault some time after a condition holds. A motion of the world.

    :param is_due: the condition.
    :param wait: s after it.
    """

    outcome = None

    def __init__(
        self, world: World, controller: ArmController, fault: str, wait: float, is_due: Callable[[], bool]
    ) -> None:
        self._world, self._controller, self._arm = world, controller, controller.arm
        self._kind, self._value, _ = FAULTS[fault]
        self._wait, self._is_due = wait, is_due
        self._injected_at: float | None = None
        self.result = Result()

    @property
    def is_injected(self) -> bool:
        """Whether the fault has come."""
        return self._injected_at is not None

    @property
    def has_ended(self) -> bool:
        """Whether enough was observed."""
        if self._injected_at is None:
            return False
        stop, now = self._controller.stop, self._world.time
        return now > self._injected_at + AFTER or (stop is not None and now > stop.time + AFTER_STOP)

    def update(self, dt: float) -> None:
        """Called before each step."""
        if self._injected_at is None:
            self._wait -= dt if self._is_due() else 0.0
            if self._wait > 0.0:
                return
            self._world.faults.set(self._kind, self._arm.id, self._value)
            self._injected_at = self._world.time
        result, stop = self.result, self._controller.stop
        result.peak = max(result.peak, math.hypot(*self._arm.wrench()[:3]))
        if stop is None:
            return
        if not result.quantity:
            result.quantity, result.delay = stop.quantity, stop.time - self._injected_at
        if self._world.time >= stop.time + REST_TIME:
            result.speed = max(result.speed, *map(abs, self._arm.velocities()))

    def close(self) -> None:
        """Ends the fault."""
        self._world.motions.remove(self)
        self._world.faults.clear(self._kind, self._arm.id)


def row(skill: str, fault: str, results: Sequence[Result]) -> str:
    """Formats the results of one skill and fault as a row of a table."""
    stopped = [result for result in results if result.quantity]
    delay = max((result.delay for result in stopped), default=math.nan)
    kinds = ", ".join(sorted({result.quantity for result in stopped}))
    peak, speed = max(r.peak for r in results), max(r.speed for r in results)
    return f"| {skill} | {fault} | {len(results)} | {len(stopped)} ({kinds}) | {delay:.2f} | {peak:.0f} | {speed:.3f} |"
