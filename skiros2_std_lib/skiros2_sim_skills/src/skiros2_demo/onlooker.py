"""What happens to a goal, and to the trees of one robot, in the order in which it is heard of."""

from __future__ import annotations

import queue
from typing import Any

import actionlib
import rospy

from skiros2_msgs.msg import TreeProgress

#: What has happened: a list of `SkillProgress` (a tree), an `AchieveFeedback`, or an `AchieveResult`.
Event = Any


class Onlooker:
    """Listens from its creation on; needs an initialised ROS node. `close` ends it.

    :param robot: the skill manager's node name, with its leading slash.
    """

    def __init__(self, robot: str) -> None:
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._subscriber = rospy.Subscriber(f"{robot}/monitor", TreeProgress, self._take_progress)

    def close(self) -> None:
        """Listens no more."""
        self._subscriber.unregister()

    def take_feedback(self, handle: Any, feedback: Any) -> None:
        """Puts a goal's feedback among the events. Any thread."""
        self._events.put(feedback)

    def take_transition(self, handle: Any) -> None:
        """Puts a goal's result among the events, when there is one. Any thread."""
        if handle.get_comm_state() == actionlib.CommState.DONE:
            self._events.put(handle.get_result())

    def next_event(self, timeout: float) -> Event | None:
        """What has happened next, None when nothing does within the time (s)."""
        try:
            return self._events.get(timeout=timeout)
        except queue.Empty:
            return None

    def _take_progress(self, message: Any) -> None:
        if message.progress:
            self._events.put(message.progress)
