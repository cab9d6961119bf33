"""Checks of connections: are all subscribers connected, is an action server, is a response of it overdue?"""

from __future__ import annotations

import select
import time
from typing import Any

import rosgraph
import rospy
from actionlib import CommState

from skiros2_common.command_line.master import XMLRPC_ERRORS

#: How long registered subscribers, which may have died, have to connect (s of wall time).
CONNECTION_TIMEOUT = 1.0

_POLL_PERIOD = 0.005  # s

#: How long to wait for the other subscribers of an action's goals (s).
_SUBSCRIBERS_TIMEOUT = 5.0


def was_closed(transport: Any) -> bool:
    """Whether the server has closed an idle connection: then its end can be read.

    :param transport: of a persistent `rospy.ServiceProxy`; None if it is not connected.
    """
    poll = select.poll()  # unlike select(), also for descriptors above 1023
    try:
        poll.register(transport.socket, select.POLLIN)
    except (AttributeError, TypeError, ValueError):  # there is no transport, or its socket is closed
        return True
    return bool(poll.poll(0))


class RegisteredSubscribers:
    """The nodes that the master lists as subscribers of a publisher's topic. Calls the master once, when created.

    :param timeout: s of wall time after which subscribers without a connection count as dead.
    """

    def __init__(self, publisher: Any, timeout: float = CONNECTION_TIMEOUT) -> None:
        self._publisher = publisher
        self._deadline = time.monotonic() + timeout
        try:
            _, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
        except (*XMLRPC_ERRORS, rosgraph.MasterException):
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


class ServerWatch:
    """Watches the server of one action client.

    :param client: an `actionlib.SimpleActionClient` or `ActionClient`.
    """

    def __init__(self, client: Any) -> None:
        self._client = getattr(client, "action_client", client)
        self._last_status: Any = self._client.last_status_msg
        self._status_time = self._created = time.monotonic()
        self._overdue: dict[int, float] = {}  # start time (s) by the communication state
        self._subscribers: RegisteredSubscribers | None = None

    @property
    def name(self) -> str:
        """The action's name."""
        return str(self._client.ns)

    def is_connected(self) -> bool:
        """Whether a goal would reach the server and all other subscribers, and the result this client."""
        # Like SimpleActionClient.wait_for_server, which blocks, forever if the simulated clock is paused.
        client = self._client
        if not client.last_status_msg:
            return False
        server = client.last_status_msg._connection_header["callerid"]
        is_connected = (
            client.pub_goal.impl.has_connection(server)
            and client.pub_cancel.impl.has_connection(server)
            and any(c.callerid_pub == server for c in client.result_sub.impl.connections)
            and any(c.callerid_pub == server for c in client.feedback_sub.impl.connections)
        )
        if is_connected and self._subscribers is None:
            self._subscribers = RegisteredSubscribers(client.pub_goal)
        if not is_connected or self._subscribers is None:
            return False
        return self.age() > _SUBSCRIBERS_TIMEOUT or self._subscribers.are_connected()

    def age(self) -> float:
        """Time since creation (s of wall time)."""
        return time.monotonic() - self._created

    def time_since_status(self) -> float:
        """Time since the last status message, as observed by calls of this method (s of wall time).

        A server publishes its status five times a second.
        """
        status = self._client.last_status_msg
        if status is not self._last_status:
            self._last_status, self._status_time = status, time.monotonic()
        return time.monotonic() - self._status_time

    def status_is_later(self, age: float, seconds: float) -> bool:
        """Whether the last status message was published so long after a goal was sent (s, wall time of both hosts).

        A busy client receives status messages late. Always true in simulated time, which may be paused.

        :param age: time since the goal was sent (s); the wall clock may have been set meanwhile.
        """
        status = self._client.last_status_msg
        if status is None or not rospy.rostime.is_wallclock():
            return True
        return bool(status.header.stamp.to_sec() - (time.time() - age) > seconds)

    def time_without_result(self, handle: Any) -> float:
        """Time since the server reported the end of a goal whose result is missing, as observed by calls (s).

        A result is lost if the server has just been restarted: the old connections still seem to be open.
        """
        return self._time_in(handle, CommState.WAITING_FOR_RESULT)

    def time_without_ack(self, handle: Any) -> float:
        """Time since a goal was sent that the server has not acknowledged, as observed by calls (s).

        A goal can be lost like a result.
        """
        return self._time_in(handle, CommState.WAITING_FOR_GOAL_ACK)

    def _time_in(self, handle: Any, state: int) -> float:
        if handle.get_comm_state() != state:
            self._overdue.pop(state, None)
            return 0.0
        return time.monotonic() - self._overdue.setdefault(state, time.monotonic())
