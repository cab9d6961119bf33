"""The node watch detects the end of a process at once, and ignores short interruptions."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from skiros2_world_model.ros import last_will
from skiros2_world_model.ros.last_will import NodeWatch
from support.ros import wait_until

#: A node's slave API, as far as it is asked; it prints where it listens.
NODE = """
import os, sys
from rosgraph.xmlrpc import ThreadingXMLRPCServer, SilenceableXMLRPCRequestHandler
SilenceableXMLRPCRequestHandler.protocol_version = sys.argv[1]
server = ThreadingXMLRPCServer(("localhost", 0), log_requests=0)
server.register_function(lambda caller: [1, "", os.getpid()], "getPid")
print(server.server_address[1], flush=True)
server.serve_forever()
"""

#: How long a node that goes on has to be left alone (s).
WHILE = 1.0


class RosNode:
    """A process with a slave API."""

    def __init__(self, protocol: str = "HTTP/1.1") -> None:
        self.process = subprocess.Popen([sys.executable, "-c", NODE, protocol], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())
        self.pid = self.process.pid

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


class Wire:
    """Stands between watch and node, and can be cut."""

    def __init__(self, node: RosNode) -> None:
        self._node = node
        self._listener = socket.create_server(("localhost", 0))
        self.port = self._listener.getsockname()[1]
        self._ends: list[socket.socket] = []
        self.connections = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Breaks all connections that are there."""
        ends, self._ends = self._ends, []
        for end in ends:
            with contextlib.suppress(OSError):  # the other end was first
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)  # at once, also while the other thread waits in `accept`
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(("localhost", self._node.port))
            except OSError:
                near.close()
                return
            self._ends += [near, far]
            self.connections += 1
            for source, target in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=(source, target), daemon=True).start()

    def _pump(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(4096):
                target.sendall(data)
        with contextlib.suppress(OSError):  # also after a reset: what breaks on one side breaks on the other
            target.shutdown(socket.SHUT_RDWR)


@pytest.fixture
def node() -> Iterator[RosNode]:
    node = RosNode()
    yield node
    node.kill()


@pytest.fixture
def watch() -> Iterator[Any]:
    """Starts watches, and gives the event that tells that the node is gone."""
    watches = []

    def start(port: int, pid: int) -> threading.Event:
        gone = threading.Event()
        watches.append(NodeWatch(f"http://localhost:{port}/", pid, gone.set))
        watches[-1].start()
        return gone

    yield start
    for started in watches:
        started.stop()
        started.join(5.0)
        assert not started.is_alive()


def has_answered(wire: Wire, count: int) -> None:
    wait_until(lambda: wire.connections == count, what="the connection")


def test_a_node_that_is_killed_is_gone(node: RosNode, watch: Any) -> None:
    gone = watch(node.port, node.pid)
    assert not gone.wait(0.3)
    node.kill()
    assert gone.wait(5.0)


def test_one_that_is_stopped_for_a_while_is_not(node: RosNode, watch: Any) -> None:
    gone = watch(node.port, node.pid)
    os.kill(node.pid, signal.SIGSTOP)
    assert not gone.wait(WHILE)
    os.kill(node.pid, signal.SIGCONT)
    assert not gone.wait(WHILE)
    node.kill()
    assert gone.wait(5.0)


def test_one_that_is_killed_while_it_is_stopped_is_gone(node: RosNode, watch: Any) -> None:
    os.kill(node.pid, signal.SIGSTOP)
    gone = watch(node.port, node.pid)
    assert not gone.wait(0.3)
    node.kill()
    assert gone.wait(5.0)


def test_broken_connection_to_a_live_node_is_restored(node: RosNode, watch: Any) -> None:
    wire = Wire(node)
    gone = watch(wire.port, node.pid)
    for count in (1, 2, 3):
        has_answered(wire, count)
        wire.cut()
    has_answered(wire, 4)
    assert not gone.is_set()
    wire.close()
    node.kill()
    assert gone.wait(5.0)


def test_a_node_that_closes_each_connection_is_watched_too(watch: Any) -> None:
    node = RosNode("HTTP/1.0")
    wire = Wire(node)
    gone = watch(wire.port, node.pid)
    has_answered(wire, 3)
    assert not gone.is_set()
    wire.close()
    node.kill()
    assert gone.wait(5.0)


def test_another_process_in_its_place_is_not_the_node(node: RosNode, watch: Any) -> None:
    assert watch(node.port, node.pid + 1).wait(5.0)


def test_address_that_is_not_a_node_counts_as_dead(watch: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(last_will, "_PAUSES", (0.01, 0.05))
    with socket.create_server(("localhost", 0)) as stranger:
        answers = [b"", b"no HTTP", b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n"] * 2

        def answer() -> None:
            for text in answers:
                connection, _ = stranger.accept()
                with connection:
                    connection.recv(4096)
                    connection.sendall(text)

        threading.Thread(target=answer, daemon=True).start()
        assert watch(stranger.getsockname()[1], 1).wait(10.0)


class Network:
    """Between a watch and its node; it may be down."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.is_up = True
        self.refused = threading.Semaphore(0)
        connect = NodeWatch._connect

        def try_to_connect(watch: NodeWatch) -> socket.socket:
            if not self.is_up:
                self.refused.release()
                raise OSError(errno.EHOSTUNREACH, "No route to host")
            return connect(watch)

        monkeypatch.setattr(NodeWatch, "_connect", try_to_connect)


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Network:
    return Network(monkeypatch)


def test_one_that_is_out_of_reach_for_long_is_gone(
    node: RosNode, watch: Any, network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(last_will, "UNREACHABLE_TIMEOUT", 0.5)
    wire = Wire(node)
    gone = watch(wire.port, node.pid)
    has_answered(wire, 1)
    network.is_up = False
    assert not gone.wait(WHILE)  # the connection holds
    wire.cut()
    assert network.refused.acquire(timeout=5.0)
    assert gone.wait(5.0)


def test_one_that_is_out_of_reach_for_a_while_is_not(node: RosNode, watch: Any, network: Network) -> None:
    wire = Wire(node)
    gone = watch(wire.port, node.pid)
    has_answered(wire, 1)
    network.is_up = False
    wire.cut()
    assert network.refused.acquire(timeout=5.0)
    network.is_up = True
    has_answered(wire, 2)
    assert not gone.is_set()


def test_one_that_was_never_reached_is_not_gone(
    node: RosNode, watch: Any, network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(last_will, "UNREACHABLE_TIMEOUT", 0.1)
    network.is_up = False
    gone = watch(node.port, node.pid)
    for _ in range(3):
        assert network.refused.acquire(timeout=5.0)
    network.is_up = True
    assert not gone.wait(0.3)
    node.kill()
    assert gone.wait(5.0)


def test_other_process_at_the_first_connection_is_not_a_death(node: RosNode) -> None:
    gone = threading.Event()
    watch = NodeWatch(f"http://localhost:{node.port}/", node.pid + 1, gone.set)
    watch.connect()
    watch.start()
    watch.join(5.0)
    assert not watch.is_alive()
    assert not gone.is_set()


def test_nobody_is_met_where_nobody_listens(node: RosNode) -> None:
    node.kill()
    with pytest.raises(OSError):
        NodeWatch(f"http://localhost:{node.port}/", node.pid, list).connect()


def test_one_that_dies_right_after_it_was_met_is_gone(node: RosNode) -> None:
    gone = threading.Event()
    watch = NodeWatch(f"http://localhost:{node.port}/", node.pid, gone.set)
    watch.connect()
    node.kill()
    watch.start()
    assert gone.wait(5.0)
