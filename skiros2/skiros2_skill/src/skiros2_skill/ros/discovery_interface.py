"""How nodes of a kind find each other: one topic asks, on the other each names itself."""

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

#: A node unseen for this many discovery periods counts as down.
PERIODS_UNTIL_DOWN = 2


class DiscoverableNode:
    """A node that names itself, at the start and whenever somebody asks."""

    def init_discovery(self, namespace: str, node_id: str) -> None:
        """Starts to answer.

        :param namespace: of the two topics, such as `/skill_managers`; the slash may be left out.
        :param node_id: the name to give.
        """
        namespace = _absolute(namespace)
        self._description_pub = rospy.Publisher(f"{namespace}/description", String, queue_size=10, latch=True)
        self._description_pub.publish(node_id)
        self._discovery_sub = rospy.Subscriber(
            f"{namespace}/discovery", Empty, lambda _: self._description_pub.publish(node_id)
        )

    def stop_discovery(self) -> None:
        """No more answers."""
        self._discovery_sub.unregister()
        self._description_pub.unregister()


class DiscoveryInterface:
    """Follows which nodes are there."""

    def init_discovery(
        self,
        namespace: str,
        on_active: Callable[[str], Any],
        on_inactive: Callable[[str], Any],
        discovery_period: Any = rospy.Duration(1),  # noqa: B008 - the contract's default
    ) -> None:
        """Starts to follow. The callbacks are called from ROS's threads, one at a time.

        :param namespace: of the two topics, such as `/skill_managers`; the slash may be left out.
        :param on_active: called with the name of a node that has come up.
        :param on_inactive: called with the name of one that has gone.
        :param discovery_period: how often to ask.
        """
        watch_master()
        self._on_active, self._on_inactive = on_active, on_inactive
        self._seen: dict[str, float] = {}  # when, in wall time: simulated time may stand still, or run fast
        self._lives: dict[str, Any] = {}  # by name, the header of the connection to it: another life has another
        self._discovery_lock = threading.RLock()
        self._down_after = PERIODS_UNTIL_DOWN * discovery_period.to_sec()
        namespace = _absolute(namespace)
        self._ask_pub = rospy.Publisher(f"{namespace}/discovery", Empty, queue_size=10)
        self._names_sub = rospy.Subscriber(f"{namespace}/description", String, self._on_name)
        self._discovery_ended = threading.Event()
        self._ask()
        period = discovery_period.to_sec()
        threading.Thread(target=self._ask_again, args=(period,), name="discovery", daemon=True).start()

    def stop_discovery(self) -> None:
        """Follows no more."""
        self._discovery_ended.set()
        self._names_sub.unregister()
        self._ask_pub.unregister()

    def _on_name(self, message: Any) -> None:
        name, header = message.data, message._connection_header
        with self._discovery_lock:
            if header["callerid"] == name:
                before = self._lives.get(name)
                self._lives[name] = header
                if name in self._seen and before is not None and before is not header:
                    self._drop(name)
            new = name not in self._seen
            self._seen[name] = time.monotonic()
            if new:
                self._on_active(name)

    def _drop(self, name: str) -> None:
        del self._seen[name]
        self._on_inactive(name)

    def _ask_again(self, period: float) -> None:
        while not self._discovery_ended.wait(period) and not rospy.is_shutdown():
            try:
                self._ask()
            except rospy.ROSException as error:  # the topic was closed meanwhile
                log.debug("discovery has ended: %s", error)
                return

    def _ask(self) -> None:
        now = time.monotonic()
        with self._discovery_lock:
            for name, seen in list(self._seen.items()):
                if now - seen > self._down_after:
                    self._drop(name)
        self._ask_pub.publish()


def _absolute(namespace: str) -> str:
    return f"/{namespace.strip('/')}"
