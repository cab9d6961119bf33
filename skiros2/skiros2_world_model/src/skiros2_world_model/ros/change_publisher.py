"""Publishes the changes of the world model on its monitor topic, beside the requests that make them."""

from __future__ import annotations

import logging
import queue
import threading
from typing import Any

import rospy

from skiros2_msgs import msg as msgs

log = logging.getLogger(__name__)

#: Messages that wait for a slow subscriber; a subscriber that misses some sees the gap and fetches the scene again.
_QUEUE_SIZE = 1000


class ChangePublisher:
    """The latched topic `~monitor`. Messages are sent in the order of `put`, by a thread of its own.

    A message costs half as much time as the request behind it; a request holds the lock of the world model and its
    client waits for the answer, so neither waits for the topic as well.
    """

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("~monitor", msgs.WmMonitor, latch=True, queue_size=_QUEUE_SIZE)
        self._waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="change publisher", daemon=True).start()

    @property
    def topic(self) -> rospy.Publisher:
        return self._publisher

    def put(self, message: Any) -> None:
        """Has a `WmMonitor` sent soon. Any thread; returns at once."""
        self._waiting.put(message)

    def _run(self) -> None:
        while True:
            message = self._waiting.get()
            try:
                self._publisher.publish(message)
            except rospy.ROSException:
                log.debug("change %s is not published: the node ends", message.snapshot_id)
                return
