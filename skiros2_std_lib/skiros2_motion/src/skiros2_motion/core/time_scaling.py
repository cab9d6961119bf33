"""How fast a motion follows its path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Maximum speed and acceleration of a minimum-jerk profile of length and duration 1.
PEAK_SPEED, PEAK_ACCELERATION = 1.875, 5.7735
#: Time by which a motion advances at most between two updates of its reference (s): a late one delays the motion, the
#: reference does not jump.
MAX_PERIOD = 0.1


def minimum_jerk(time: float, duration: float) -> float:
    """Return the completed fraction of a motion with a minimum-jerk profile (Flash and Hogan, 1985):
    10 t^3 - 15 t^4 + 6 t^5.

    :param time: since the start; before it 0, after the duration 1.
    """
    if time >= duration:
        return 1.0
    t = max(time, 0.0) / duration
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def fastest_speeds(limits: Array, speeding_up: Array, braking: Array, lengths: Array) -> Array:
    """Return the highest speeds along a path within limits of speed and acceleration, by one pass forwards and one
    backwards (Bobrow, Dubowsky and Gibson, Time-Optimal Control of Robotic Manipulators Along Specified Paths, 1985).

    :param limits: maximum speed at each point.
    :param speeding_up, braking: maximum acceleration and deceleration between each point and the next.
    :param lengths: between each point and the next.
    """
    squares: list[float] = np.square(limits).tolist()
    gains, losses = (2.0 * speeding_up * lengths).tolist(), (2.0 * braking * lengths).tolist()
    for i, gain in enumerate(gains):
        squares[i + 1] = min(squares[i + 1], squares[i] + gain)
    for i in reversed(range(len(losses))):
        squares[i] = min(squares[i], squares[i + 1] + losses[i])
    speeds: Array = np.sqrt(squares)
    return speeds
