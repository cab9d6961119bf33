"""Waiting for all who listen to a topic, so that its first message is lost to none of them, a recorder for example."""

from __future__ import annotations

import http.client
import time
import xmlrpc.client
from typing import Any

import rosgraph
import rospy

#: How long to wait for listeners that are registered, but may be gone (s of wall time).
PATIENCE = 0.5

_POLL = 0.005  # s
_NO_ANSWER = (OSError, http.client.HTTPException, xmlrpc.client.Error, rosgraph.MasterException)


def wait_for_listeners(publisher: Any, patience: float = PATIENCE) -> None:
    """Waits until all nodes are connected that the master knows as subscribers of a publisher's topic.

    Without a master that answers, it does not wait.

    :param patience: s at most.
    """
    end = time.monotonic() + patience
    try:
        _, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    except _NO_ANSWER:
        return
    wanted = next((len(nodes) for topic, nodes in subscribers if topic == publisher.resolved_name), 0)
    while publisher.get_num_connections() < wanted and time.monotonic() < end:
        time.sleep(_POLL)
