"""Connections to this process, each greeted in a thread of its own.

rospy reads the first words of a new connection in the one thread that takes connections, for up to 60 s. Whoever
connects and says nothing (a port scanner) or speaks another protocol (an XML-RPC call for a process that had this port
before) keeps everybody else from a node's topics and services for that long.
"""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable

import rospy.impl.tcpros_base as tcpros

log = logging.getLogger(__name__)

#: How long a new connection may take to say what it wants (s).
HANDSHAKE_TIMEOUT = 10.0

#: The longest header that is listened to (bytes). Those of ROS clients hold the text of a message type at most.
MAX_HEADER_BYTES = 4 * 1024 * 1024

Greet = Callable[[socket.socket, tuple[str, int]], None]


def handshake_in_threads() -> None:
    """From now on no connection waits for another one. To be called after `rospy.init_node`; once is enough."""
    tcpros.start_tcpros_server()
    server = tcpros._tcpros_server.tcp_ros_server
    if not isinstance(server.inbound_handler, _Greeter):
        server.inbound_handler = _Greeter(server.inbound_handler)


class _Greeter:
    """Called by the thread that takes connections."""

    def __init__(self, greet: Greet) -> None:
        self._greet = greet

    def __call__(self, connection: socket.socket, address: tuple[str, int]) -> None:
        threading.Thread(target=self._hear, args=(connection, address), name="inbound", daemon=True).start()

    def _hear(self, connection: socket.socket, address: tuple[str, int]) -> None:
        usual = connection.gettimeout()
        connection.settimeout(HANDSHAKE_TIMEOUT)
        try:
            size = int.from_bytes(connection.recv(4, socket.MSG_PEEK), "little")
        except OSError as error:
            log.debug("a connection from %s said nothing: %s", address, error)
            connection.close()
            return
        if size > MAX_HEADER_BYTES:
            log.debug("a connection from %s does not speak ROS", address)
            connection.close()
            return
        connection.settimeout(usual)
        self._greet(connection, address)
