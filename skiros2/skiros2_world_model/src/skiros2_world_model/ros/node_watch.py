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
_PAUSES = 0.1, 1.0  # s before it connects again: at first, and where one connection after the other breaks

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
        self._connection: socket.socket | None = None
        self._is_met = False
        self._reached: float | None = None  # when it was there last

    def meet(self) -> None:
        """Connects to a node that is there now. Who listens at its address and is another was never the node.

        :raises OSError: nobody can be reached there.
        """
        self._connection = self._connect()
        self._is_met = True

    def stop(self) -> None:
        """Watches no more. Does not wait for the thread."""
        self._ended.set()
        if self._connection is not None:
            _shut(self._connection)

    def run(self) -> None:
        if self._wait_until_gone() and not self._ended.is_set():
            self._on_gone()

    def _wait_until_gone(self) -> bool:
        """Returns when the node is gone, or False when it was never there, or the watch has ended."""
        pause, longest = _PAUSES
        silent = 0  # connections in a row on which nobody has told who he is
        while not self._ended.is_set():
            began = time.monotonic()
            try:
                with self._connection or self._connect() as connection:
                    pid = _ask_pid(connection)
                    if pid == self._pid:
                        silent, self._is_met = 0, False
                        _wait_for_end(connection)
                    elif pid is not None or silent == _NO_ANSWERS:
                        if self._is_met:
                            log.warning("process %s, not %s, listens at %s:%s", pid, self._pid, *self._address)
                        return not self._is_met
                    else:
                        silent += 1
                self._reached = time.monotonic()
            except ConnectionRefusedError:
                return True
            except OSError as error:
                if self._reached is not None and time.monotonic() - self._reached > OUT_OF_REACH:
                    log.warning("%s:%s cannot be reached any more: %s", *self._address, error)
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


def _shut(connection: socket.socket) -> None:
    """Wakes who reads from a connection."""
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError as error:
        log.debug("the connection is closed already: %s", error)
