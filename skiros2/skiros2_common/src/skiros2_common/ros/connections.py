"""Checks of connections: are all subscribers connected, is an action server, is a response of it overdue?"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
import urllib.parse
from collections.abc import Callable
from typing import Any

import rosgraph
import rospy
from actionlib import CommState

from skiros2_common.command_line.master import XMLRPC_ERRORS

#: How long registered subscribers that may have died have to connect (s of wall time).
CONNECTION_TIMEOUT = 1.0

_POLL_PERIOD = 0.005  # s

#: How long those that run have to connect (s of wall time).
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

    :param timeout: s of wall time after which subscribers that have died do not count.
    :param longest: s of wall time after which those without a connection do not count.
    """

    def __init__(
        self, publisher: Any, timeout: float = CONNECTION_TIMEOUT, longest: float = _SUBSCRIBERS_TIMEOUT
    ) -> None:
        self._publisher = publisher
        self._deadline = time.monotonic() + timeout
        self._latest = time.monotonic() + max(timeout, longest)
        self._names: list[str] = []
        self._alive: int | None = None  # how many of them run; None: not known
        self._checking: threading.Thread | None = None
        try:
            _, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
        except (*XMLRPC_ERRORS, rosgraph.MasterException):
            return
        self._names = next((nodes for topic, nodes in subscribers if topic == publisher.resolved_name), [])

    def are_connected(self) -> bool:
        """Whether all of them that run are connected, the longest time has passed, or no master answered."""
        number, now = self._publisher.get_num_connections(), time.monotonic()
        if number >= len(self._names) or now >= self._latest:
            return True
        if now < self._deadline:
            return False
        if self._checking is None:  # on a busy machine, a recorder may need seconds to connect
            self._checking = threading.Thread(target=self._count_alive, name="liveness of subscribers", daemon=True)
            self._checking.start()
        return self._alive is not None and bool(number >= self._alive)

    def _count_alive(self) -> None:
        self._alive = sum(map(_is_running, self._names))


def _is_running(node: str) -> bool:
    """Whether a node that the master lists takes connections."""
    try:
        address = urllib.parse.urlparse(rosgraph.Master(rospy.get_name()).lookupNode(node))
        socket.create_connection((address.hostname, address.port), CONNECTION_TIMEOUT).close()
    except (*XMLRPC_ERRORS, rosgraph.MasterException, ValueError):
        return False
    return True


def wait_for_subscribers(publisher: Any, timeout: float = CONNECTION_TIMEOUT) -> None:
    """Waits until all registered subscribers of a publisher's topic are connected.

    :param timeout: s at most.
    """
    subscribers = RegisteredSubscribers(publisher, timeout)
    while not subscribers.are_connected():
        time.sleep(_POLL_PERIOD)


def send_goal(
    client: Any,
    goal: Any,
    done_cb: Callable[[int, Any], None] | None = None,
    feedback_cb: Callable[[Any], None] | None = None,
) -> None:
    """Sends a goal by an `actionlib.SimpleActionClient`, whose callbacks get every answer, also the first ones.

    Its own `send_goal` makes the goal known to the callbacks when it returns, and they drop what arrives before. Here
    they wait until then. They are called in the client's threads.
    """
    manager = getattr(getattr(client, "action_client", None), "manager", None)  # stand-ins of libraries have none
    with manager.list_mutex if manager is not None else contextlib.nullcontext():
        client.send_goal(goal, done_cb=done_cb, feedback_cb=feedback_cb)


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
        return self._subscribers.are_connected()

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
