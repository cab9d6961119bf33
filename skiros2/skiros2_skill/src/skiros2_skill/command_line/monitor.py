"""Monitors the tasks of a manager as a ROS node."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import rospy

from skiros2_common.command_line.command import Unavailable
from skiros2_msgs.msg import TreeProgress
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.command_line.connection import is_alive

#: Time without messages after which the manager is checked (s).
_ALIVE_CHECK_PERIOD = 2.0


def become_node(name: str) -> None:
    """Makes this process a ROS node with a unique name; Ctrl-C stays a `KeyboardInterrupt`."""
    rospy.init_node(name, anonymous=True, disable_signals=True, disable_rosout=True)


class TaskMonitor:
    """Receives the progress of a manager's tasks from its creation on."""

    def __init__(self, manager: ManagerClient) -> None:
        self._manager = manager
        self._received = threading.Condition()
        self._messages: list[Any] = []
        self._received_at = time.monotonic()
        self._subscriber = rospy.Subscriber(f"{manager.name}/monitor", TreeProgress, self._on_progress, queue_size=100)

    def close(self) -> None:
        self._subscriber.unregister()

    def receive(self, timeout: float) -> list[Sequence[Any]]:
        """The messages since the last call, in order: the nodes of a task each.

        :param timeout: s to wait for a message.
        :returns: [] after a timeout.
        :raises Unavailable: the manager has died.
        """
        with self._received:
            if not self._messages:
                self._received.wait(timeout)
            messages, self._messages = self._messages, []
        if not messages and time.monotonic() - self._received_at > _ALIVE_CHECK_PERIOD:
            if not is_alive(self._manager.name):
                raise Unavailable(f"the skill manager {self._manager.name} is gone")
            self._received_at = time.monotonic()
        return messages

    def _on_progress(self, message: Any) -> None:
        if message.progress:
            with self._received:
                self._messages.append(message.progress)
                self._received_at = time.monotonic()
                self._received.notify_all()
