"""Waiting for the subscribers of a topic, so that all of them, such as a recorder, receive its first message."""

from __future__ import annotations

import time
from typing import Any

import rosgraph
import rospy

from skiros2_common.command_line.master import XMLRPC_ERRORS

#: How long registered subscribers, which may have died, have to connect (s of wall time).
CONNECTION_TIMEOUT = 1.0

_POLL_PERIOD = 0.005  # s
_ERRORS = (*XMLRPC_ERRORS, rosgraph.MasterException)


class RegisteredSubscribers:
    """The nodes that the master lists as subscribers of a publisher's topic. Calls the master once, when created.

    :param timeout: s of wall time after which subscribers without a connection count as dead.
    """

    def __init__(self, publisher: Any, timeout: float = CONNECTION_TIMEOUT) -> None:
        self._publisher = publisher
        self._deadline = time.monotonic() + timeout
        try:
            _, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
        except _ERRORS:
            subscribers = []
        self._count = next((len(nodes) for topic, nodes in subscribers if topic == publisher.resolved_name), 0)

    def are_connected(self) -> bool:
        """Whether all of them are connected, the timeout has passed, or no master answered."""
        return self._publisher.get_num_connections() >= self._count or time.monotonic() >= self._deadline


def wait_for_subscribers(publisher: Any, timeout: float = CONNECTION_TIMEOUT) -> None:
    """Waits until all registered subscribers of a publisher's topic are connected.

    :param timeout: s at most.
    """
    subscribers = RegisteredSubscribers(publisher, timeout)
    while not subscribers.are_connected():
        time.sleep(_POLL_PERIOD)
