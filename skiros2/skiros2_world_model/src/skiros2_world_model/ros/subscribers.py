"""Waits for subscribers of a topic."""

from __future__ import annotations

import logging
import time
from typing import Any

import rosgraph
import rospy

log = logging.getLogger(__name__)


def wait_for_subscribers(publisher: rospy.Publisher, timeout: float = 0.5) -> None:
    """Blocks until the registered subscribers of a topic are connected, so that they miss no message.

    For example, a recorder that was started before the system then records all changes.

    :param timeout: in s; the master may still list killed nodes as subscribers.
    """
    waiting_for = _subscribers(publisher.resolved_name)
    deadline = time.monotonic() + timeout
    while publisher.get_num_connections() < len(waiting_for):
        if time.monotonic() > deadline or rospy.is_shutdown():
            names = ", ".join(sorted(waiting_for))
            log.info("not all subscribers (%s) have connected to %s", names, publisher.resolved_name)
            return
        time.sleep(0.005)


def _subscribers(topic: str) -> set[str]:
    listed: Any = rosgraph.Master(rospy.get_name()).getSystemState()[1]
    return {node for name, nodes in listed if name == topic for node in nodes}
