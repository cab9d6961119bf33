"""A node that publishes the first message of a topic waits, for a limited time, until all subscribers are connected."""

from __future__ import annotations

import fcntl
import resource
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.ros import connections
from skiros2_common.ros.connections import RegisteredSubscribers, wait_for_subscribers, was_closed


class FakePublisher:
    resolved_name = "/job/goal"

    def __init__(self, *connections: int) -> None:
        self._connections = list(connections)

    def get_num_connections(self) -> int:
        return self._connections.pop(0) if len(self._connections) > 1 else self._connections[0]


@pytest.fixture
def listening() -> Iterator[list[socket.socket]]:
    """The socket of the recorder, empty: it has died."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield [server]


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch, listening: list[socket.socket]) -> list[Any]:
    """The topics of the master with their subscribers: a server and a recorder subscribe to the publisher's topic."""
    known: list[Any] = [["/other", ["/a", "/b", "/c"]], ["/job/goal", ["/server", "/recorder"]]]

    class Master:
        def __init__(self, caller: str) -> None:
            pass

        def lookupNode(self, name: str) -> str:
            if name != "/recorder" or not listening:
                raise connections.rosgraph.MasterError(f"no node {name}")
            return f"http://127.0.0.1:{listening[0].getsockname()[1]}/"

        def getSystemState(self) -> Any:
            if not known:
                raise ConnectionRefusedError
            return [], known, []

    monkeypatch.setattr(connections.rosgraph, "Master", Master)
    return known


def test_are_connected_is_true_when_all_registered_subscribers_are() -> None:
    found = RegisteredSubscribers(FakePublisher(0, 1, 2), timeout=60.0)
    assert [found.are_connected() for _ in range(3)] == [False, False, True]


def test_are_connected_is_true_after_the_timeout_without_those_that_have_died(listening: list[Any]) -> None:
    listening.clear()
    found = RegisteredSubscribers(FakePublisher(0), timeout=0.0, longest=60.0)
    found.are_connected()
    assert found._checking is not None
    found._checking.join()
    assert found.are_connected()


def test_are_connected_is_false_while_a_running_subscriber_connects() -> None:
    publisher = FakePublisher(0)
    found = RegisteredSubscribers(publisher, timeout=0.0, longest=60.0)
    assert not found.are_connected()
    assert found._checking is not None
    found._checking.join()
    assert not found.are_connected()
    publisher._connections = [1]  # of the recorder; the server has died
    assert found.are_connected()


def test_are_connected_is_true_after_the_longest_time() -> None:
    assert RegisteredSubscribers(FakePublisher(1), timeout=0.0, longest=0.0).are_connected()


def test_are_connected_is_true_without_a_master(registered: list[Any]) -> None:
    registered.clear()
    assert RegisteredSubscribers(FakePublisher(0), timeout=60.0).are_connected()


def test_are_connected_is_true_for_a_topic_without_subscribers(registered: list[Any]) -> None:
    del registered[1]
    assert RegisteredSubscribers(FakePublisher(0), timeout=60.0).are_connected()


def test_wait_for_subscribers_returns_with_the_last_connection() -> None:
    publisher = FakePublisher(0, 0, 2)
    wait_for_subscribers(publisher, timeout=60.0)
    assert publisher.get_num_connections() == 2


@pytest.mark.parametrize("descriptor", [0, 1100])
def test_idle_connection_was_closed_when_its_server_has_closed_it(descriptor: int) -> None:
    """Also in a process with more than 1024 open files."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard <= descriptor:
        pytest.skip("this process may not open so many files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, descriptor + 1), hard))
    server, client = socket.socketpair()
    with server, client, socket.socket(fileno=fcntl.fcntl(client, fcntl.F_DUPFD, descriptor)) as connection:
        transport = SimpleNamespace(socket=connection)
        assert not was_closed(transport)
        server.close()
        assert was_closed(transport)
    assert was_closed(transport)
    assert was_closed(None)
