"""The service `~last_will`: stores the last wills of nodes and executes them when the nodes die."""

from __future__ import annotations

import http.client
import logging
import os
import socket
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Sequence
from typing import Any
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
from rosgraph.network import parse_http_host_and_port

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.operations import CleanupAction
from skiros2_common.ros.utils import deserializePropertyMap, serializePropertyMap
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_world_model.core.last_will import LastWill, LastWillStore, NodeProcess
from skiros2_world_model.ros.service_pool import service_handler

log = logging.getLogger(__name__)

#: How long a machine may be unreachable before its nodes count as dead (s).
UNREACHABLE_TIMEOUT = 10.0
#: The number of connections in a row without an answer after which the node counts as dead.
_MAX_UNANSWERED = 5

_CONNECT_TIMEOUT = 2.0  # s
_PAUSES = 0.1, 1.0  # the initial and the maximum pause before it reconnects (s)

#: TCP keep-alive: idle time (s), interval (s), number of probes.
_KEEP_ALIVE = ((socket.TCP_KEEPIDLE, 2), (socket.TCP_KEEPINTVL, 1), (socket.TCP_KEEPCNT, 5))


class NodeWatch(threading.Thread):
    """A thread that waits for the death of a node's process.

    It keeps a connection to the node's slave API open, which the kernel closes when the process ends in any way, but
    not while the process is stopped or busy. When the connection breaks, the node is dead if its address refuses
    connections or another process answers there.

    :param uri: the node's slave API.
    :param pid: the node's process id.
    :param on_gone: called once, in this thread, when the node has died.
    """

    def __init__(self, uri: str, pid: int, on_gone: Callable[[], None]) -> None:
        super().__init__(name=f"watch of {uri}", daemon=True)
        host, port = rosgraph.network.parse_http_host_and_port(uri)
        self._address = str(host), int(port)
        self._pid = pid
        self._on_gone = on_gone
        self._ended = threading.Event()
        self._connection: socket.socket | None = None
        self._is_connected = False  # whether `connect` has opened the connection and no answer was read yet
        self._reached: float | None = None  # the last time the node was reachable

    def connect(self) -> None:
        """Connects to a running node. If another process answers at its address, the node never existed.

        :raises OSError: the address cannot be reached.
        """
        self._connection = self._connect()
        self._is_connected = True

    def stop(self) -> None:
        """Stops watching. Does not wait for the thread."""
        self._ended.set()
        if self._connection is not None:
            _shut(self._connection)

    def run(self) -> None:
        if self._wait_until_gone() and not self._ended.is_set():
            self._on_gone()

    def _wait_until_gone(self) -> bool:
        """Blocks until the node has died; returns False when it never existed or the watch was stopped."""
        pause, longest = _PAUSES
        unanswered = 0  # connections in a row on which the node has not answered
        while not self._ended.is_set():
            began = time.monotonic()
            try:
                with self._connection or self._connect() as connection:
                    pid = _ask_pid(connection)
                    if pid == self._pid:
                        unanswered, self._is_connected = 0, False
                        _wait_for_end(connection)
                    elif pid is not None or unanswered == _MAX_UNANSWERED:
                        if self._is_connected:
                            log.warning("process %s, not %s, listens at %s:%s", pid, self._pid, *self._address)
                        return not self._is_connected
                    else:
                        unanswered += 1
                self._reached = time.monotonic()
            except ConnectionRefusedError:
                return True
            except OSError as error:
                if self._reached is not None and time.monotonic() - self._reached > UNREACHABLE_TIMEOUT:
                    log.warning("%s:%s cannot be reached: %s", *self._address, error)
                    return True
            self._connection = None
            self._ended.wait(pause)
            pause = _PAUSES[0] if time.monotonic() - began > 2 * longest else min(2 * pause, longest)
        return False

    def _connect(self) -> socket.socket:
        connection = socket.create_connection(self._address, _CONNECT_TIMEOUT)
        connection.settimeout(None)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEP_ALIVE:
            connection.setsockopt(socket.IPPROTO_TCP, option, value)
        self._connection = connection
        if self._ended.is_set():
            _shut(connection)
        return connection


def _ask_pid(connection: socket.socket) -> int | None:
    """The process id of the node at the other end; None when it is not a node, or the connection breaks first."""
    body = xmlrpc.client.dumps((rospy.get_name(),), "getPid").encode()
    head = f"POST / HTTP/1.1\r\nHost: node\r\nContent-Type: text/xml\r\nContent-Length: {len(body)}\r\n\r\n"
    try:
        connection.sendall(head.encode() + body)
        answer = http.client.HTTPResponse(connection, method="POST")
        answer.begin()
        values: Any = xmlrpc.client.loads(answer.read())[0]
        return int(values[0][2])
    except (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError, LookupError, TypeError, ValueError):
        return None


def _wait_for_end(connection: socket.socket) -> None:
    """Blocks until a connection is closed or breaks."""
    try:
        while connection.recv(1024):
            pass
    except OSError as error:
        log.debug("the connection to a node broke: %s", error)


def _shut(connection: socket.socket) -> None:
    """Shuts a connection down, which wakes a reading thread."""
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError as error:
        log.debug("the connection is closed already: %s", error)


def last_will_request(actions: Sequence[CleanupAction]) -> srvs.WmLastWillRequest:
    """Creates a request of `WmLastWill` for the node of this process."""
    messages = [
        msgs.WmBequest(b.key, b.value, b.relation, b.below, serializePropertyMap(b.properties)) for b in actions
    ]
    return srvs.WmLastWillRequest(rospy.get_name(), rospy.get_node_uri(), os.getpid(), messages)


def msg2last_will(msg: srvs.WmLastWillRequest) -> LastWill:
    """Converts a request of `WmLastWill` to a last will.

    :raises SkirosError: the request is invalid.
    """
    try:
        parse_http_host_and_port(msg.node_uri)
    except ValueError as error:
        text = f"the last will of {msg.owner!r}: node_uri is {msg.node_uri!r}, expected http://HOST:PORT/: {error}"
        raise WrongValue(text) from None
    actions = [
        CleanupAction(b.key, b.value, b.relation, b.below, deserializePropertyMap(b.properties)) for b in msg.bequests
    ]
    return LastWill(msg.owner, NodeProcess(msg.node_uri, msg.pid), actions)


class LastWillService:
    """The service, and a `NodeWatch` for each node with a last will, including those from the journal.

    :param wills: stores and executes the last wills.
    """

    def __init__(self, wills: LastWillStore) -> None:
        self._wills = wills
        self._watches: dict[str, tuple[NodeProcess, NodeWatch]] = {}
        self._lock = threading.Lock()
        with self._lock:
            for will in wills.all():
                self._watch(will).start()
        self._service = rospy.Service("~last_will", srvs.WmLastWill, service_handler(self._on_last_will))

    def _on_last_will(self, request: srvs.WmLastWillRequest) -> srvs.WmLastWillResponse:
        will = msg2last_will(request)
        with self._lock:
            if will.actions:
                self._wills.put(will)
                self._start_watch(will)
            else:
                self._wills.remove(will.owner)
                self._stop(will.owner)
        return srvs.WmLastWillResponse()

    def _start_watch(self, will: LastWill) -> None:
        """Starts watching the process of a last will, unless it is watched already."""
        process, watch = self._watches.get(will.owner, (None, None))
        if watch is not None and process == will.process and watch.is_alive():
            return
        watch = self._watch(will)
        try:
            watch.connect()
        except OSError as error:
            text = "%s cannot be reached at %s (%s): its last will is kept until a node of this name sets a new one"
            log.warning(text, will.owner, will.process.uri, error)
        else:
            watch.start()

    def _watch(self, will: LastWill) -> NodeWatch:
        self._stop(will.owner)
        owner, process = will.owner, will.process
        watch = NodeWatch(process.uri, process.pid, lambda: self._wills.execute(owner, process))
        self._watches[owner] = process, watch
        return watch

    def _stop(self, owner: str) -> None:
        if owner in self._watches:
            self._watches.pop(owner)[1].stop()
