"""Motions of the tool as poses over time, within limits of speed and acceleration."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.arm_kinematics import distances
from skiros2_motion.core.geometry import Pose, between
from skiros2_motion.core.gripper import GripperEvent
from skiros2_motion.core.time_scaling import PEAK_ACCELERATION, PEAK_SPEED, fastest_speeds, minimum_jerk
from skiros2_teaching.core.taught_path import TaughtPath

Array = npt.NDArray[np.float64]

#: Period of the points at which limits are evaluated (s of the taught path).
_STEP = 0.01
#: Radius that makes rotations comparable with translations (m).
_RADIUS = 0.1
#: Fraction of the acceleration limits for changes of the speed, and for changes of the direction: together at most 1.
_SHARE = 0.7
#: Minimum speed within a path, so that slow taught motions do not stand still (m/s).
_SLOWEST = 0.005


@dataclass(frozen=True)
class Limits:
    """Limits of a motion of the tool.

    :param speed: m/s.
    :param angular_speed: rad/s.
    :param acceleration: m/s2.
    :param angular_acceleration: rad/s2.
    :raises WrongValue: a limit is not a finite number above 0; the text lists all of them.
    """

    speed: float = 0.1
    angular_speed: float = 0.5
    acceleration: float = 0.5
    angular_acceleration: float = 2.0

    def __post_init__(self) -> None:
        wrong = [f"{key} {value}" for key, value in vars(self).items() if not (math.isfinite(value) and value > 0.0)]
        if wrong:
            raise WrongValue(f"{', '.join(wrong)}: expected finite numbers above 0")


class TimedMotion(Protocol):
    """A motion of the tool that starts and ends at rest."""

    @property
    def duration(self) -> float:
        """s."""
        ...

    def pose(self, time: float) -> Pose:
        """Returns the pose at a time since the start (s); after the end, the last one."""
        ...


class Line:
    """A straight line with a minimum-jerk profile."""

    def __init__(self, start: Pose, goal: Pose, limits: Limits) -> None:
        self._start, self._goal = start, goal
        length, turn = distances(start, goal)
        fast = PEAK_SPEED * max(length / limits.speed, turn / limits.angular_speed)
        strong = max(length / limits.acceleration, turn / limits.angular_acceleration)
        self.duration = max(fast, math.sqrt(PEAK_ACCELERATION * strong))

    def pose(self, time: float) -> Pose:
        part = minimum_jerk(time, self.duration)
        return between(self._start, self._goal, part) if part < 1.0 else self._goal


class Section:
    """A part of a taught path, at most as fast as taught times a factor. Pauses are dropped.

    The speed profile is the fastest one within the limits.

    :param begin, end: s, as taught.
    :param scaling: of the taught speed.
    """

    def __init__(self, path: TaughtPath, begin: float, end: float, limits: Limits, scaling: float = 1.0) -> None:
        self._path = path
        taught = np.linspace(begin, end, max(3, math.ceil((end - begin) / _STEP) + 1))
        velocity, change, turn, turn_change = path.rates(taught)
        speed = np.linalg.norm(velocity, axis=1)
        # rate: generalised speed, of the motion as taught
        rate = np.maximum(np.hypot(speed, _RADIUS * turn), 1e-6)
        per_rate, turn_per_rate = np.maximum(speed / rate, 1e-6), np.maximum(turn / rate, 1e-6)
        fastest = np.minimum(limits.speed / per_rate, limits.angular_speed / turn_per_rate)
        bending = np.sqrt(_SHARE * limits.acceleration / np.maximum(np.linalg.norm(change, axis=1), 1e-6))
        turning = np.sqrt(_SHARE * limits.angular_acceleration / np.maximum(turn_change, 1e-6))
        fastest = np.minimum(fastest, np.maximum(rate * np.minimum(bending, turning), _SLOWEST))
        fastest = np.minimum(fastest, np.maximum(scaling * rate, _SLOWEST))
        fastest[[0, -1]] = 0.0
        strongest = _SHARE * np.minimum(limits.acceleration / per_rate, limits.angular_acceleration / turn_per_rate)
        length = (rate[1:] + rate[:-1]) / 2.0 * np.diff(taught)
        rates = fastest_speeds(fastest, strongest[1:], strongest[:-1], length)
        steps = 2.0 * length / np.maximum(rates[1:] + rates[:-1], 1e-9)
        times = np.concatenate(([0.0], np.cumsum(steps)))
        distinct = np.concatenate(([True], np.diff(times) > 1e-6))
        distinct[-1], self._end = True, end
        if np.count_nonzero(distinct) > 1 and times[-1] - times[distinct][-2] < 1e-9:
            distinct[np.flatnonzero(distinct)[-2]] = False
        self.duration = float(times[-1])
        self._taught = PchipInterpolator(times[distinct], taught[distinct]) if np.count_nonzero(distinct) > 1 else None

    def pose(self, time: float) -> Pose:
        if self._taught is None or time >= self.duration:
            return self._path.pose(self._end)
        return self._path.pose(float(self._taught(max(time, 0.0))))


def sections(path: TaughtPath, limits: Limits, scaling: float = 1.0) -> Iterator[Section | GripperEvent]:
    """Yields the motions of a path and its gripper events, in order. The tool rests at each event."""
    begin = 0.0
    for event in path.events:
        if event.time > begin + _STEP:
            yield Section(path, begin, event.time, limits, scaling)
            begin = event.time
        yield event
    if path.duration > begin + _STEP:
        yield Section(path, begin, path.duration, limits, scaling)
