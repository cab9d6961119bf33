"""Waiting for all who listen to a topic, so that its first message is lost to none of them, a recorder for example."""

from __future__ import annotations

import time
from typing import Any

import rosgraph
import rospy

from skiros2_common.core.no_answer import NO_ANSWER

#: How long to wait for listeners that are registered, but may be gone (s of wall time).
PATIENCE = 1.0

_POLL = 0.005  # s
_NO_ANSWER = (*NO_ANSWER, rosgraph.MasterException)


class Listeners:
    """The nodes that the master knows, at its creation, as subscribers of a publisher's topic. Asks it once.

    :param patience: s of wall time, after which those that are not connected count as gone.
    """

    def __init__(self, publisher: Any, patience: float = PATIENCE) -> None:
        self._publisher = publisher
        self._end = time.monotonic() + patience
        try:
            _, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
        except _NO_ANSWER:
            subscribers = []
        self._wanted = next((len(nodes) for topic, nodes in subscribers if topic == publisher.resolved_name), 0)

    def are_connected(self) -> bool:
        """Whether all of them are connected, or had the time to be; also without a master that answers."""
        return self._publisher.get_num_connections() >= self._wanted or time.monotonic() >= self._end


def wait_for_listeners(publisher: Any, patience: float = PATIENCE) -> None:
    """Waits until all nodes are connected that the master knows as subscribers of a publisher's topic.

    :param patience: s at most.
    """
    listeners = Listeners(publisher, patience)
    while not listeners.are_connected():
        time.sleep(_POLL)
