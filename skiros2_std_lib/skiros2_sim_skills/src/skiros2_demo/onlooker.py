"""What a node learns of a system by listening: the world, the trees of one robot, and how its goal goes on."""

from __future__ import annotations

import queue
import threading
from typing import Any

import actionlib
import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_demo.world_state import WorldState
from skiros2_msgs.msg import TreeProgress, WmMonitor

#: What has happened: a list of `SkillProgress` (a tree), an `AchieveFeedback`, or an `AchieveResult`.
Event = Any


class Onlooker:
    """Listens from its creation on; needs an initialised ROS node. `close` ends it.

    :param robot: the skill manager's node name, with its leading slash.
    """

    def __init__(self, robot: str) -> None:
        self._lock = threading.Lock()
        self._world = WorldState()
        self._problem = ""
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._subscribers = [
            rospy.Subscriber("wm/monitor", WmMonitor, self._take_change),
            rospy.Subscriber(f"{robot}/monitor", TreeProgress, self._take_progress),
        ]

    def close(self) -> None:
        """Listens no more."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def world(self) -> WorldState:
        """The world now.

        :raises SkirosError: a change could not be followed.
        """
        with self._lock:
            if self._problem:
                raise SkirosError(self._problem)
            return self._world.copy()

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

    def _take_change(self, message: Any) -> None:
        with self._lock:
            try:
                self._world.apply(message)
            except SkirosError as error:
                self._problem = str(error)

    def _take_progress(self, message: Any) -> None:
        if message.progress:
            self._events.put(message.progress)
