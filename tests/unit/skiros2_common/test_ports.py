"""Ports for servers that a program starts."""

from __future__ import annotations

import socket
from pathlib import Path

from skiros2_common.core.ports import free_port, is_free


def test_a_free_port_is_free_and_is_given_to_nobody_who_asks_for_any() -> None:
    first, last = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    for _ in range(50):
        port = free_port()
        assert is_free(port)
        assert not first <= port <= last


def test_a_port_that_somebody_listens_on_is_not_free() -> None:
    with socket.socket() as server:
        server.bind(("localhost", free_port()))
        server.listen()
        assert not is_free(server.getsockname()[1])
