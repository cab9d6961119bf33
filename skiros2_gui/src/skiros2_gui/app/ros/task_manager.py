"""The connection to the task manager."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatusArray

from skiros2_common.core.errors import Refused
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION, TaskManagerInterface

#: Without a status message for this time the task manager counts as down (s of wall time). It publishes at 5 Hz.
STATUS_TIMEOUT = 2.0


class TaskManagerConnection:
    """Watches the task manager `tm` in this node's namespace and sends it goals.

    :param on_change: called, in any thread, when it has connected or disconnected.
    """

    def __init__(self, on_change: Callable[[], None]) -> None:
        self.name = rospy.resolve_name(ACHIEVE_ACTION).rpartition("/")[0]
        self.is_up = False
        self.since = 0.0
        self._on_change = on_change
        self._last_status = -STATUS_TIMEOUT
        self._client: TaskManagerInterface | None = None
        self._goal_lock = threading.Lock()
        self._status = rospy.Subscriber(f"{ACHIEVE_ACTION}/status", GoalStatusArray, self._on_status, queue_size=1)

    def achieve(self, goals: str, on_feedback: Callable[[Any], None], quality: str = "", seconds: float = 0.0) -> Any:
        """See `app.system.Planner`.

        :raises Refused: another goal of this window is running.
        :raises TimedOut: the task manager does not answer.
        """
        return self._request(
            lambda client: client.achieve(goals, feedback_cb=on_feedback, quality=quality, seconds=seconds)
        )

    def plan(self, goals: str) -> Any:
        """See `app.system.Planner`.

        :raises Refused, TimedOut: see `achieve`.
        """
        return self._request(lambda client: client.make_plan(goals))

    def _request(self, send: Callable[[TaskManagerInterface], None]) -> Any:
        """Sends a request and returns its result."""
        if not self._goal_lock.acquire(blocking=False):
            raise Refused("a goal of this window is running; cancel it, or wait for its end")
        try:
            if self._client is None:
                self._client = TaskManagerInterface()
            send(self._client)
            return self._client.wait_for_result()
        finally:
            self._goal_lock.release()

    def cancel(self) -> None:
        """See `app.system.Planner`."""
        if self._client is not None:
            self._client.preempt()

    def check(self) -> None:
        """Detects that it is down. To be called periodically."""
        is_silent = time.monotonic() - self._last_status > STATUS_TIMEOUT
        if self.is_up and (is_silent or self._status.get_num_connections() == 0):
            self._set(False)

    def close(self) -> None:
        """Disconnects."""
        self._status.unregister()

    def _on_status(self, _: Any) -> None:
        self._last_status = time.monotonic()
        self._set(True)

    def _set(self, is_up: bool) -> None:
        if is_up != self.is_up:
            self.is_up, self.since = is_up, time.time()
            self._on_change()
