"""The time that skills wait by."""

from __future__ import annotations

import sys
import time


def now() -> float:
    """Seconds: ROS time in a ROS node, so that a simulation may slow it down or stop it, else the machine's.

    With simulated time it is 0.0 until the first message on `/clock`. For differences only.
    """
    rospy = sys.modules.get("rospy")
    if rospy is not None and rospy.core.is_initialized():
        return float(rospy.get_time())
    return time.monotonic()


class Stopwatch:
    """The time since it was made, by `now`."""

    def __init__(self) -> None:
        self._started_at = now()

    def passed(self) -> float:
        """Seconds; none before simulated time has begun."""
        if self._started_at == 0.0:
            self._started_at = now()
        return now() - self._started_at
