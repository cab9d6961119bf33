"""Those who listened before a publisher was there."""

from __future__ import annotations

import logging
import time
from typing import Any

import rosgraph
import rospy

log = logging.getLogger(__name__)


def wait_for_subscribers(publisher: rospy.Publisher, timeout: float = 0.5) -> None:
    """Waits until those who have subscribed to a topic are connected, so that they miss nothing from here on.

    A recorder that is started before the system has the whole history, for one.

    :param timeout: s; nodes that were killed may still be listed as subscribers.
    """
    waiting_for = _subscribers(publisher.resolved_name)
    deadline = time.monotonic() + timeout
    while publisher.get_num_connections() < len(waiting_for):
        if time.monotonic() > deadline or rospy.is_shutdown():
            log.info("not all of %s have connected to %s", ", ".join(sorted(waiting_for)), publisher.resolved_name)
            return
        time.sleep(0.005)


def _subscribers(topic: str) -> set[str]:
    listed: Any = rosgraph.Master(rospy.get_name()).getSystemState()[1]
    return {node for name, nodes in listed if name == topic for node in nodes}
