"""Who sends the first message of a topic knows when all who listen to it are connected, and does not wait for ever."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.ros import listeners
from skiros2_common.ros.listeners import Listeners, wait_for_listeners


class FakePublisher:
    resolved_name = "/job/goal"

    def __init__(self, *connections: int) -> None:
        self._connections = list(connections)

    def get_num_connections(self) -> int:
        return self._connections.pop(0) if len(self._connections) > 1 else self._connections[0]


@pytest.fixture(autouse=True)
def subscribers(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the master knows: a server and a recorder listen."""
    known: list[Any] = [["/other", ["/a", "/b", "/c"]], ["/job/goal", ["/server", "/recorder"]]]

    class Master:
        def __init__(self, caller: str) -> None:
            pass

        def getSystemState(self) -> Any:
            if not known:
                raise ConnectionRefusedError
            return [], known, []

    monkeypatch.setattr(listeners.rosgraph, "Master", Master)
    return known


def test_all_who_are_known_have_to_be_connected() -> None:
    there = Listeners(FakePublisher(0, 1, 2), patience=60.0)
    assert [there.are_connected() for _ in range(3)] == [False, False, True]


def test_who_is_registered_but_gone_is_not_waited_for_long() -> None:
    assert Listeners(FakePublisher(1), patience=0.0).are_connected()


def test_without_a_master_nobody_is_waited_for(subscribers: list[Any]) -> None:
    subscribers.clear()
    assert Listeners(FakePublisher(0), patience=60.0).are_connected()


def test_a_topic_that_nobody_listens_to_needs_no_connection(subscribers: list[Any]) -> None:
    del subscribers[1]
    assert Listeners(FakePublisher(0), patience=60.0).are_connected()


def test_waiting_ends_with_the_last_connection() -> None:
    publisher = FakePublisher(0, 0, 2)
    wait_for_listeners(publisher, patience=60.0)
    assert publisher.get_num_connections() == 2
