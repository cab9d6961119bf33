"""Handshakes of inbound TCPROS connections in separate threads.

rospy reads the header of a new connection in its single accepting thread, for up to 60 s. A client that sends nothing
(a port scanner) or another protocol (an XML-RPC call to an earlier process on this port) blocks all topics and services
of the node for that time.
"""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable

import rospy.impl.tcpros_base as tcpros

log = logging.getLogger(__name__)

#: The timeout for the header of a new connection (s).
HANDSHAKE_TIMEOUT = 10.0

#: The maximum size of a header (bytes). The longest ones of ROS clients contain a message definition.
MAX_HEADER_BYTES = 4 * 1024 * 1024

Handshake = Callable[[socket.socket, tuple[str, int]], None]


def handshake_in_threads() -> None:
    """Moves the handshakes to threads, so that connections do not block each other. Call it after `rospy.init_node`."""
    tcpros.start_tcpros_server()
    server = tcpros._tcpros_server.tcp_ros_server
    if not isinstance(server.inbound_handler, _HandshakeThreads):
        server.inbound_handler = _HandshakeThreads(server.inbound_handler)


class _HandshakeThreads:
    """The handler that the accepting thread calls."""

    def __init__(self, handshake: Handshake) -> None:
        self._handshake = handshake

    def __call__(self, connection: socket.socket, address: tuple[str, int]) -> None:
        threading.Thread(target=self._check_header, args=(connection, address), name="inbound", daemon=True).start()

    def _check_header(self, connection: socket.socket, address: tuple[str, int]) -> None:
        timeout = connection.gettimeout()
        connection.settimeout(HANDSHAKE_TIMEOUT)
        try:
            size = int.from_bytes(connection.recv(4, socket.MSG_PEEK), "little")
        except OSError as error:
            log.debug("connection from %s: no header received: %s", address, error)
            connection.close()
            return
        if size > MAX_HEADER_BYTES:
            log.debug("connection from %s: not a TCPROS header", address)
            connection.close()
            return
        connection.settimeout(timeout)
        self._handshake(connection, address)
