"""A node that follows the tasks of a manager."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import rospy

from skiros2_common.command_line.command import Unavailable
from skiros2_msgs.msg import TreeProgress
from skiros2_skill.command_line.connection import Manager

#: After so long without news it is asked whether it is still there (s).
_SILENCE = 2.0


def become_node(name: str) -> None:
    """Makes this process a node, under a name of its own; Ctrl-C stays a `KeyboardInterrupt`."""
    rospy.init_node(name, anonymous=True, disable_signals=True, disable_rosout=True)


class Follower:
    """Listens to what a manager tells of its tasks, from its creation on."""

    def __init__(self, manager: Manager) -> None:
        self._manager = manager
        self._news = threading.Condition()
        self._waiting: list[Any] = []
        self._heard_at = time.monotonic()
        self._subscriber = rospy.Subscriber(f"{manager.name}/monitor", TreeProgress, self._take, queue_size=100)

    def close(self) -> None:
        self._subscriber.unregister()

    def news(self, timeout: float) -> list[Sequence[Any]]:
        """What has come since the last call: for each task its nodes, of one that is told of several times all of it.

        :param timeout: how long to wait for some (s); none then.
        :raises Unavailable: the manager is gone.
        """
        with self._news:
            if not self._waiting:
                self._news.wait(timeout)
            news, self._waiting = self._waiting, []
        if not news and time.monotonic() - self._heard_at > _SILENCE:
            if not self._manager.is_there():
                raise Unavailable(f"the skill manager {self._manager.name} is gone")
            self._heard_at = time.monotonic()
        return news

    def _take(self, message: Any) -> None:
        if message.progress:
            with self._news:
                self._waiting.append(message.progress)
                self._heard_at = time.monotonic()
                self._news.notify_all()
