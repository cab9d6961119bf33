"""The window's connection to the task manager."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatusArray

from skiros2_common.core.errors import Refused
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION, TaskManagerInterface

#: A task manager that is silent for so long counts as gone (s of wall time). It tells its state five times a second.
SILENCE = 2.0


class TaskManagerLink:
    """Whether the task manager `tm` in this node's namespace is there, and what it is asked for.

    :param changed: called, in any thread, when it has come up or gone.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self.name = rospy.resolve_name(ACHIEVE_ACTION).rpartition("/")[0]
        self.is_up = False
        self.since = 0.0
        self._changed = changed
        self._heard_at = -SILENCE
        self._client: TaskManagerInterface | None = None
        self._asking = threading.Lock()
        self._status = rospy.Subscriber(f"{ACHIEVE_ACTION}/status", GoalStatusArray, self._on_status, queue_size=1)

    def achieve(self, goals: str, told: Callable[[Any], None], wish: str = "", seconds: float = 0.0) -> Any:
        """See `core.system.Planner`.

        :raises Refused: another goal of this window is under way.
        :raises TimedOut: the task manager does not answer.
        """
        if not self._asking.acquire(blocking=False):
            raise Refused("a goal of this window is under way; cancel it, or wait for its end")
        try:
            if self._client is None:
                self._client = TaskManagerInterface()
            self._client.achieve(goals, feedback_cb=told, quality=wish, seconds=seconds)
            return self._client.wait_for_result()
        finally:
            self._asking.release()

    def cancel(self) -> None:
        """See `core.system.Planner`."""
        if self._client is not None:
            self._client.preempt()

    def check(self) -> None:
        """Notices that it has gone. Called from time to time."""
        is_silent = time.monotonic() - self._heard_at > SILENCE
        if self.is_up and (is_silent or self._status.get_num_connections() == 0):
            self._set(False)

    def close(self) -> None:
        """Follows it no more."""
        self._status.unregister()

    def _on_status(self, _: Any) -> None:
        self._heard_at = time.monotonic()
        self._set(True)

    def _set(self, is_up: bool) -> None:
        if is_up != self.is_up:
            self.is_up, self.since = is_up, time.time()
            self._changed()
