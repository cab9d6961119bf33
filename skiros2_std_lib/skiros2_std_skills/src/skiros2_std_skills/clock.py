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
