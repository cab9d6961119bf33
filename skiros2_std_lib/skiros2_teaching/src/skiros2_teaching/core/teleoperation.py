"""Teleoperation: twists of a hand-held device move the reference of a compliant arm.

The reference moves by twist x time, with limited speeds, and leads the tool by a limited distance: what blocks the tool
is pressed with lead x stiffness at most, and a released tool does not catch up over a long way.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.arm_kinematics import difference
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, multiplied, normalized, rotated

Array = npt.NDArray[np.float64]

#: Time after which a twist ends (s of wall time): the device is off, or was let go.
TIMEOUT = 0.1


class Twist(NamedTuple):
    """A commanded velocity of the tool.

    :param linear: m/s.
    :param angular: rad/s.
    :param in_tool: whether its axes are those of the tool; else those of the arm's base.
    """

    linear: Vector
    angular: Vector
    in_tool: bool = True


class Limits(NamedTuple):
    """Maximum speed (m/s, rad/s) of the reference, and maximum distance (m, rad) from the tool to it."""

    speed: float
    angular_speed: float
    lead: float
    angular_lead: float


class TwistInput:
    """The last twist of a device. Thread-safe.

    :param clock: wall clock (s).
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._last: Twist | None = None
        self._at = 0.0

    def put(self, twist: Twist) -> None:
        """Sets the twist that was received now.

        :raises WrongValue: a number is not finite; there is no twist then.
        """
        if not all(map(math.isfinite, (*twist.linear, *twist.angular))):
            self.stop()
            raise WrongValue(f"twist {twist.linear} {twist.angular}: expected finite numbers")
        with self._lock:
            self._last, self._at = twist, self._clock()

    def stop(self) -> None:
        """Ends the last twist."""
        with self._lock:
            self._last = None

    def twist(self) -> Twist | None:
        """Returns the last twist; None if there is none, or it is older than `TIMEOUT`."""
        with self._lock:
            return self._last if self._clock() - self._at <= TIMEOUT else None

    def close(self) -> None:
        """Disconnects from the device."""


def next_reference(reference: Pose, tool: Pose, twist: Twist, limits: Limits, dt: float) -> Pose:
    """Returns the reference after a time, in the base frame.

    :param reference: the last one.
    :param tool: pose of the tool.
    :param dt: s.
    """
    ahead = difference(reference, tool)
    turn = tool.orientation if twist.in_tool else IDENTITY.orientation
    for part, velocity, fastest, longest in (
        (slice(0, 3), twist.linear, limits.speed, limits.lead),
        (slice(3, 6), twist.angular, limits.angular_speed, limits.angular_lead),
    ):
        ahead[part] += dt * _limited(np.array(rotated(turn, velocity)), fastest)
        ahead[part] = _limited(ahead[part], longest)
    x, y, z = (at + off for at, off in zip(tool.position, ahead[:3].tolist(), strict=True))
    turned = Rotation.from_rotvec(ahead[3:]).as_quat().tolist()
    return Pose((x, y, z), normalized(multiplied(turned, tool.orientation)))


def _limited(vector: Array, most: float) -> Array:
    """Returns a vector with a maximum length."""
    length = float(np.linalg.norm(vector))
    return vector * (most / length) if length > most else vector
