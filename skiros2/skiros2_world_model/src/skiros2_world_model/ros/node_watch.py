"""Whether one life of a node goes on, without asking it again and again."""

from __future__ import annotations

import http.client
import logging
import socket
import threading
import time
import xmlrpc.client
from collections.abc import Callable
from typing import Any
from xml.parsers.expat import ExpatError

import rosgraph
import rospy

log = logging.getLogger(__name__)

#: How long a machine may be out of reach before its nodes count as gone (s).
OUT_OF_REACH = 10.0
#: How often somebody else, or nobody, may answer where the node was before it counts as gone.
_NO_ANSWERS = 5

_CONNECT_TIMEOUT = 2.0  # s
_PAUSE = 0.1  # s before it connects again
_PACE = 1.0  # s from one connection to the next one of a node that lives and closes them

#: When the kernel looks whether the other machine is there: after s, every s, so often.
_KEEP_ALIVE = ((socket.TCP_KEEPIDLE, 2), (socket.TCP_KEEPINTVL, 1), (socket.TCP_KEEPCNT, 5))


class NodeWatch(threading.Thread):
    """Waits for the end of one life of a node.

    It keeps a connection to the node's slave API open, which the kernel closes when the process ends, however it ends.
    A process that is stopped or busy keeps it open. When it breaks, the node is gone if nobody listens there any more,
    or another process does.

    :param uri: where the node listens.
    :param pid: its process number, as it tells it itself.
    :param on_gone: called once, in this thread, when the node is gone.
    """

    def __init__(self, uri: str, pid: int, on_gone: Callable[[], None]) -> None:
        super().__init__(name=f"watch of {uri}", daemon=True)
        host, port = rosgraph.network.parse_http_host_and_port(uri)
        self._address = str(host), int(port)
        self._pid = pid
        self._on_gone = on_gone
        self._ended = threading.Event()
        self._socket: socket.socket | None = None

    def stop(self) -> None:
        """Watches no more. Does not wait for the thread."""
        self._ended.set()
        _shut(self._socket)

    def run(self) -> None:
        reached = time.monotonic()
        unknown = 0  # connections in a row on which nobody has told who he is
        while not self._ended.is_set():
            connected = time.monotonic()
            try:
                with self._connect() as connection:
                    reached = connected
                    pid = _ask_pid(connection)
                    if pid == self._pid:
                        unknown = 0
                        _wait_for_end(connection)
                    elif pid is not None or unknown == _NO_ANSWERS:
                        break
                    else:
                        unknown += 1
            except ConnectionRefusedError:
                break
            except OSError as error:
                if time.monotonic() - reached > OUT_OF_REACH:
                    log.warning("%s:%d cannot be reached: %s", *self._address, error)
                    break
            since = time.monotonic() - connected
            self._ended.wait(_PAUSE if unknown == 0 and since > _PACE else max(_PAUSE, _PACE - since))
        if not self._ended.is_set():
            self._on_gone()

    def _connect(self) -> socket.socket:
        connection = socket.create_connection(self._address, _CONNECT_TIMEOUT)
        connection.settimeout(None)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEP_ALIVE:
            connection.setsockopt(socket.IPPROTO_TCP, option, value)
        self._socket = connection
        if self._ended.is_set():
            _shut(connection)
        return connection


def _ask_pid(connection: socket.socket) -> int | None:
    """The process number of who listens there; None when it is no node, or says nothing until the connection breaks."""
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
    """Waits until a connection is closed or breaks."""
    try:
        while connection.recv(1024):
            pass
    except OSError as error:
        log.debug("the connection to a node broke: %s", error)


def _shut(connection: socket.socket | None) -> None:
    """Wakes who reads from a connection."""
    if connection is not None:
        try:
            connection.shutdown(socket.SHUT_RDWR)
        except OSError as error:
            log.debug("the connection is closed already: %s", error)
