"""Events of a goal and of one robot's trees, in order of arrival."""

from __future__ import annotations

import queue
from typing import Any

import actionlib
import rospy

from skiros2_msgs.msg import TreeProgress

#: A list of `SkillProgress` (a tree), an `AchieveFeedback`, or an `AchieveResult`.
Event = Any


class RunEvents:
    """Subscribes on creation, until `close`. Needs an initialised node.

    :param robot: name of the skill manager, with its leading slash.
    """

    def __init__(self, robot: str) -> None:
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._subscriber = rospy.Subscriber(f"{robot}/monitor", TreeProgress, self._on_progress)

    def close(self) -> None:
        """Unsubscribes."""
        self._subscriber.unregister()

    def on_feedback(self, handle: Any, feedback: Any) -> None:
        """Adds feedback of a goal. Thread-safe."""
        self._events.put(feedback)

    def on_transition(self, handle: Any) -> None:
        """Adds the result of a goal, once there is one. Thread-safe."""
        if handle.get_comm_state() == actionlib.CommState.DONE:
            self._events.put(handle.get_result())

    def next_event(self, timeout: float) -> Event | None:
        """Returns the next event; None after the timeout (s)."""
        try:
            return self._events.get(timeout=timeout)
        except queue.Empty:
            return None

    def _on_progress(self, message: Any) -> None:
        if message.progress:
            self._events.put(message.progress)
