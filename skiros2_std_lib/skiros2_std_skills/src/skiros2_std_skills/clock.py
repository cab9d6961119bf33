"""The time for waiting skills."""

from __future__ import annotations

import sys
import time

from skiros2_common.core.clock_notes import time_read


def now() -> float:
    """Returns s: ROS time in a ROS node, so that a simulation may slow down or stop it; otherwise the system time.

    Simulated time is 0.0 until the first message on `/clock`. Use for differences only. Evidence has what a skill reads
    while it is ticked, and a re-run of a bag returns the recorded times.
    """
    rospy = sys.modules.get("rospy")
    if rospy is not None and rospy.core.is_initialized():
        return time_read(float(rospy.get_time()))
    return time_read(time.monotonic())


class Stopwatch:
    """The time since its creation, by `now`."""

    def __init__(self) -> None:
        self._started_at = now()

    def passed(self) -> float:
        """Returns s; 0 before simulated time has started."""
        if self._started_at == 0.0:
            self._started_at = now()
        return now() - self._started_at
