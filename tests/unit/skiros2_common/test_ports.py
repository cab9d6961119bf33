"""Free ports for servers."""

from __future__ import annotations

import socket
from pathlib import Path

from skiros2_common.core.processes import free_port, is_free


def test_free_port_is_free_and_not_ephemeral() -> None:
    first, last = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    for _ in range(50):
        port = free_port()
        assert is_free(port)
        assert not first <= port <= last


def test_port_with_a_listening_server_is_not_free() -> None:
    with socket.socket() as server:
        server.bind(("localhost", free_port()))
        server.listen()
        assert not is_free(server.getsockname()[1])
