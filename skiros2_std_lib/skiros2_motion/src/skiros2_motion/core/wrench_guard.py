"""Checks of measured wrenches: when an arm must stop because of what its sensor measures, or no longer measures.

Each comparison is written so that it fails for a number that is not finite. Pure computation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from skiros2_motion.core.geometry import Vector

Array = npt.NDArray[np.float64]

#: Quantities that stop an arm: force (N) and torque (Nm) above a limit, time since the last measurement (s), number of
#: measurements that are not finite, time without a change of the wrench (s), force (N) by which the measured wrench
#: differs from the commanded one in balance.
FORCE, TORQUE, SENSOR_AGE = "force", "torque", "sensor_age"
NOT_FINITE, FROZEN, DISAGREEMENT = "not_finite", "frozen_sensor", "disagreement"
_TEXTS = {
    FORCE: ("force of {:.1f}", "N"),
    TORQUE: ("torque of {:.1f}", "Nm"),
    SENSOR_AGE: ("sensor age of {:.3f}", "s"),
    NOT_FINITE: ("number of measurements that are not finite, {:.0f},", ""),
    FROZEN: ("time without a change of the measured wrench of {:.3f}", "s"),
    DISAGREEMENT: ("difference of measured and commanded force of {:.1f}", "N"),
}

#: The axes of a wrench, with the words for them.
_AXES = {
    f"{quantity}_{axis}": (f"{_TEXTS[quantity][0]} {unit} {way} {axis}", unit)
    for quantity, unit, way in ((FORCE, "N", "along"), (TORQUE, "Nm", "about"))
    for axis in "xyz"
}

#: Maximum age of the measured wrench while it is limited (s).
SENSOR_TIMEOUT = 0.02
#: Time (s) and number of measurements without a change after which a sensor is frozen that is noisy, or whose tool has
#: moved meanwhile or presses with another force.
FROZEN_TIME, FROZEN_COUNT = 0.05, 5
#: Way (m) from which a tool has moved, speed below which it rests (m/s), and change of the commanded force (N).
_MOVED, _AT_REST, _PRESSED = 0.0001, 0.0005, 1.0
#: Difference of measured and commanded force that stops an arm, as a fraction of the limit, and its minimum (N).
DISAGREEMENT_PART, DISAGREEMENT_MIN = 0.4, 10.0
#: Maximum speed of the tool at which the forces are in balance (m/s), and time constant of the difference (s).
_BALANCED_SPEED, _BALANCE_FILTER = 0.05, 0.05
_NONE = (0.0, 0.0, 0.0)


class Limits(NamedTuple):
    """Limits of a wrench: of force (N) and torque (Nm), and of the magnitude along and about each axis of the tool; 0
    and () for none."""

    force: float = 0.0
    torque: float = 0.0
    axes: tuple[float, ...] = ()


class Violation(NamedTuple):
    """Why an arm must stop.

    :param quantity: `FORCE`, `TORQUE`, one of these with an axis (`force_x`), `SENSOR_AGE`, `NOT_FINITE`, `FROZEN` or
        `DISAGREEMENT`.
    """

    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        return violation_text(*self)


class Balance(NamedTuple):
    """What the law commands while the wrench is measured.

    :param force: force of spring, damping, wrench and load, along the axes of the measured wrench (N).
    :param speed: of the tool (m/s).
    :param dt: time since the last check (s).
    """

    force: Vector
    speed: float
    dt: float


class WrenchGuard:
    """The checks of one arm, with what they remember.

    :param is_noisy: whether each measurement of a working sensor differs from the one before. Without noise it does so
        while the tool moves, or the law presses with another force: to tell that, `check` needs the balance.
    """

    def __init__(self, is_noisy: bool) -> None:
        self.is_noisy = is_noisy
        self._last: tuple[float, ...] = ()
        self._changed_at = 0.0
        self._repeated = 0
        #: Since the last change: the way of the tool (m); and the commanded force then (N), None if it is not known.
        self._way = 0.0
        self._force: Vector | None = None
        #: Whether a limit was exceeded at the last check.
        self.was_exceeded = False
        self._difference: Vector = _NONE

    def restart(self) -> None:
        """Forgets earlier measurements."""
        self._last, self.was_exceeded, self._difference = (), False, _NONE

    def check(
        self,
        wrench: Sequence[float],
        limits: Limits,
        time: float,
        age: float = 0.0,
        balance: Balance | None = None,
    ) -> Violation | None:
        """Returns why the arm must stop; None if it need not. Without limits only numbers are checked. A limit must be
        exceeded in two checks in a row.

        :param wrench: measured: force (N), torque (Nm), along and about the axes of the tool.
        :param time: of the measurement, by a clock that does not jump (s).
        :param age: of the measurement (s).
        :param balance: for the comparison with the commanded force; None for none.
        """
        if not is_finite(wrench):
            return Violation(NOT_FINITE, 1.0, 0.0)
        if not any(limits):
            self.restart()
            return None
        if not age <= SENSOR_TIMEOUT:
            return Violation(SENSOR_AGE, age, SENSOR_TIMEOUT)
        exceeded = exceeded_limit(wrench, limits)
        was_exceeded, self.was_exceeded = self.was_exceeded, exceeded is not None
        if exceeded is not None and was_exceeded:
            return exceeded
        return self.frozen(wrench, time, balance) or self._disagreement(wrench, limits[0], balance)

    def frozen(self, wrench: Sequence[float], time: float, balance: Balance | None = None) -> Violation | None:
        """Returns for how long a wrench has not changed; None if it has, or need not change.

        :param time: of the measurement, by a clock that does not jump (s).
        :param balance: as of `check`; without it only a noisy sensor is found to be frozen.
        """
        measured = tuple(wrench)
        if measured != self._last:
            self._last, self._changed_at, self._repeated = measured, time, 0
            self._way, self._force = 0.0, balance.force if balance is not None else None
            return None
        self._repeated += 1
        passed = time - self._changed_at
        changes = self._has_to_change(balance) or self.is_noisy
        return Violation(FROZEN, passed, FROZEN_TIME) if changes and self._is_long(passed) else None

    def _is_long(self, passed: float) -> bool:
        return self._repeated >= FROZEN_COUNT and passed > FROZEN_TIME

    def _has_to_change(self, balance: Balance | None) -> bool:
        """Whether the tool has moved since the last change of the wrench, or presses with another force."""
        if balance is None:
            return False
        if self._force is None:
            self._force = balance.force
        self._way += balance.speed * balance.dt if balance.speed > _AT_REST else 0.0
        return self._way > _MOVED or math.dist(balance.force, self._force) > _PRESSED

    def _disagreement(self, wrench: Sequence[float], limit: float, balance: Balance | None) -> Violation | None:
        """Compares forces in balance: what the law exerts is what the environment answers.

        The difference accelerates the tool. At a low speed it cannot do so for long.
        """
        if balance is None or not limit or balance.speed > _BALANCED_SPEED:
            self._difference = _NONE
            return None
        part = 1.0 - math.exp(-balance.dt / _BALANCE_FILTER)
        (dx, dy, dz), (x, y, z), (fx, fy, fz) = self._difference, wrench[:3], balance.force
        self._difference = dx + part * (x + fx - dx), dy + part * (y + fy - dy), dz + part * (z + fz - dz)
        value, most = math.hypot(*self._difference), max(DISAGREEMENT_MIN, DISAGREEMENT_PART * limit)
        return None if value <= most else Violation(DISAGREEMENT, value, most)


def exceeded_limit(wrench: Sequence[float], limits: Limits) -> Violation | None:
    """Returns which limit a wrench exceeds, also by a number that is not finite; None if it exceeds none.

    :param wrench: along and about the axes of the tool (N, Nm).
    """
    for quantity, part, limit in ((FORCE, wrench[:3], limits.force), (TORQUE, wrench[3:], limits.torque)):
        value = math.hypot(*part)
        if limit and not value <= limit:
            return Violation(quantity, value, limit)
    for quantity, value, limit in zip(_AXES, wrench, limits.axes, strict=False):  # without limits of axes: none
        if limit and not abs(value) <= limit:
            return Violation(quantity, abs(value), limit)
    return None


def is_limit(quantity: str) -> bool:
    """Whether a violation is that of a limit of force or torque, not that of a sensor."""
    return quantity in (FORCE, TORQUE, *_AXES)


def limited_wrench(wrench: Array, limits: Limits) -> Array:
    """Returns a wrench along the axes of the tool (N, Nm) that is shortened to limits."""
    limited = wrench
    if limits.axes:
        most = np.where(limits.axes, limits.axes, np.inf)
        limited = np.minimum(np.maximum(wrench, -most), most)
    numbers = limited.tolist()
    for part, limit in ((slice(0, 3), limits.force), (slice(3, 6), limits.torque)):
        length = math.hypot(*numbers[part])
        if limit and not length <= limit:
            limited = limited.copy() if limited is wrench else limited
            limited[part] *= limit / length
    return limited


def is_finite(*groups: Iterable[float]) -> bool:
    """Whether all numbers are finite."""
    return all(map(math.isfinite, chain.from_iterable(groups)))


def violation_text(quantity: str, value: float, limit: float) -> str:
    """Formats a violation, also one of a driver with further quantities."""
    text, unit = _TEXTS.get(quantity, (quantity + " of {:.1f}", ""))
    if quantity in _AXES:
        text, unit = _AXES[quantity]
        return f"{text.format(value)} above the limit of {limit:g} {unit}"
    return f"{text.format(value)} {unit} above the limit of {limit:g} {unit}".replace("  ", " ").rstrip()
