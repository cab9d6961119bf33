"""Publishes the changes of the world model on its monitor topic, in a thread of its own."""

from __future__ import annotations

import logging
import queue
import threading

import rospy

from skiros2_msgs import msg as msgs

log = logging.getLogger(__name__)

#: The number of messages queued for a slow subscriber. A subscriber that misses some fetches the scene again.
_QUEUE_SIZE = 1000


class ChangePublisher:
    """The latched topic `~monitor`. A thread sends the messages in the order of `put`.

    Sending takes half as long as a request, which holds the lock of the world model while its client waits.
    """

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("~monitor", msgs.WmMonitor, latch=True, queue_size=_QUEUE_SIZE)
        self._waiting: queue.SimpleQueue[msgs.WmMonitor] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="change publisher", daemon=True).start()

    @property
    def topic(self) -> rospy.Publisher:
        return self._publisher

    def put(self, message: msgs.WmMonitor) -> None:
        """Queues a `WmMonitor`. Thread-safe; does not block."""
        self._waiting.put(message)

    def _run(self) -> None:
        while True:
            message = self._waiting.get()
            try:
                self._publisher.publish(message)
            except rospy.ROSException:
                log.debug("change %s is not published: the node shuts down", message.snapshot_id)
                return
