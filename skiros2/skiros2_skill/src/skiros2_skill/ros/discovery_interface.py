"""Discovery of nodes: one topic carries requests, the other the names of the nodes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import rospy
from std_msgs.msg import Empty, String

from skiros2_common.ros.master_watch import watch_master

log = logging.getLogger(__name__)

#: A node that has not answered for this many discovery periods counts as down.
PERIODS_UNTIL_DOWN = 2


class DiscoverableNode:
    """A node that publishes its name at the start and on every request."""

    def init_discovery(self, namespace: str, node_id: str) -> None:
        """Starts answering requests.

        :param namespace: of the two topics, such as `/skill_managers`; the slash may be omitted.
        :param node_id: the name to publish.
        """
        namespace = _absolute(namespace)
        self._description_pub = rospy.Publisher(f"{namespace}/description", String, queue_size=10, latch=True)
        self._description_pub.publish(node_id)
        self._discovery_sub = rospy.Subscriber(
            f"{namespace}/discovery", Empty, lambda _: self._description_pub.publish(node_id)
        )

    def stop_discovery(self) -> None:
        """Stops answering requests."""
        self._discovery_sub.unregister()
        self._description_pub.unregister()


class DiscoveryInterface:
    """Tracks which nodes are up."""

    def init_discovery(
        self,
        namespace: str,
        on_active: Callable[[str], Any],
        on_inactive: Callable[[str], Any],
        discovery_period: Any = rospy.Duration(1),  # noqa: B008 - the contract's default
    ) -> None:
        """Starts discovery. The callbacks are called one at a time, in threads of ROS.

        :param namespace: of the two topics, such as `/skill_managers`; the slash may be omitted.
        :param on_active: called with the name of a node that has come up.
        :param on_inactive: called with the name of a node that has gone down.
        :param discovery_period: between requests.
        """
        watch_master()
        self._on_active, self._on_inactive = on_active, on_inactive
        self._seen: dict[str, float] = {}  # of the last answer (s, monotonic; simulated time may stand still)
        self._connections: dict[str, Any] = {}  # connection header by name: a restarted node has a new one
        self._discovery_lock = threading.RLock()
        self._down_after = PERIODS_UNTIL_DOWN * discovery_period.to_sec()
        namespace = _absolute(namespace)
        self._request_pub = rospy.Publisher(f"{namespace}/discovery", Empty, queue_size=10)
        self._names_sub = rospy.Subscriber(f"{namespace}/description", String, self._on_name)
        self._discovery_ended = threading.Event()
        self._request()
        period = discovery_period.to_sec()
        threading.Thread(target=self._request_periodically, args=(period,), name="discovery", daemon=True).start()

    def stop_discovery(self) -> None:
        """Stops discovery."""
        self._discovery_ended.set()
        self._names_sub.unregister()
        self._request_pub.unregister()

    def _on_name(self, message: Any) -> None:
        name, header = message.data, message._connection_header
        with self._discovery_lock:
            if header["callerid"] == name:
                before = self._connections.get(name)
                self._connections[name] = header
                if name in self._seen and before is not None and before is not header:
                    self._drop(name)
            new = name not in self._seen
            self._seen[name] = time.monotonic()
            if new:
                self._on_active(name)

    def _drop(self, name: str) -> None:
        del self._seen[name]
        self._on_inactive(name)

    def _request_periodically(self, period: float) -> None:
        while not self._discovery_ended.wait(period) and not rospy.is_shutdown():
            try:
                self._request()
            except rospy.ROSException as error:  # the publisher was unregistered meanwhile
                log.debug("discovery has ended: %s", error)
                return

    def _request(self) -> None:
        now = time.monotonic()
        with self._discovery_lock:
            for name, seen in list(self._seen.items()):
                if now - seen > self._down_after:
                    self._drop(name)
        self._request_pub.publish()


def _absolute(namespace: str) -> str:
    return f"/{namespace.strip('/')}"
