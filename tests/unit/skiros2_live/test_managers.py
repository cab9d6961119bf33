"""The skill managers as the cell's document gets them, with stand-ins for ROS and a manager."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy

from skiros2_common.core.errors import TimedOut
from skiros2_common.core.forward_clock import now
from skiros2_live.core.patch import ManagerConnection, TaskProgress
from skiros2_live.ros import managers
from skiros2_live.ros.managers import ManagerConnections, ManagerPatch
from skiros2_skill.client.port import ALL
from skiros2_skill.ros import discovery_interface
from support.progress import RUNNING, SUCCESS, root
from support.ros import wait_until

ROBOT = "/robot"


class Topics:
    """Stands in for `rospy.Subscriber` and `rospy.Publisher`."""

    def __init__(self) -> None:
        self.callbacks: dict[str, Callable[..., None]] = {}
        self.connections = 1

    def subscribe(self, name: str, _: Any, callback: Callable[..., None], *arguments: Any, **__: Any) -> Any:
        self.callbacks[name] = lambda message: callback(message, *arguments)
        return SimpleNamespace(unregister=lambda: None, get_num_connections=lambda: self.connections)

    def advertise(self, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(publish=lambda: None, unregister=lambda: None)

    def manager_appears(self) -> None:
        header = {"callerid": ROBOT}
        self.callbacks["/skill_managers/description"](SimpleNamespace(data=ROBOT, _connection_header=header))


class Manager:
    """A manager with a paused task. It does not answer at first.

    :ivar asked: how often it was asked for its tasks.
    """

    def __init__(self, name: str, _: str) -> None:
        self.name = name
        self.asked = 0

    def read_tasks(self, task_id: int = ALL) -> list[Any]:
        self.asked += 1
        if self.asked < 3:
            raise TimedOut("it does not answer")
        return [[root(7)]] if task_id == ALL else [[root(6, SUCCESS, 1)]]


@pytest.fixture
def topics(monkeypatch: pytest.MonkeyPatch) -> Iterator[Topics]:
    made = Topics()
    monkeypatch.setattr(rospy, "Subscriber", made.subscribe)
    monkeypatch.setattr(rospy, "Publisher", made.advertise)
    monkeypatch.setattr(discovery_interface, "watch_master", lambda: None)
    monkeypatch.setattr(managers, "ManagerClient", Manager)
    monkeypatch.setattr(managers, "_RETRY_DELAY", 0.01)
    yield made


def test_paused_and_ended_tasks_are_reported_by_a_manager_that_answers_late(topics: Topics) -> None:
    patches: list[ManagerPatch] = []
    is_reported = threading.Event()

    def report(patch: ManagerPatch) -> None:
        patches.append(patch)
        if isinstance(patch, TaskProgress) and patch.is_past:
            is_reported.set()

    connections = ManagerConnections("tests", report)
    try:
        topics.manager_appears()
        assert is_reported.wait(10.0)
        assert patches[0] == ManagerConnection(ROBOT, True)
        progress = [patch for patch in patches if isinstance(patch, TaskProgress)]
        assert [(p.manager, p.task, p.is_past) for p in progress] == [(ROBOT, 7, False), (ROBOT, 6, True)]
    finally:
        connections.close()


def test_manager_is_asked_for_its_tasks_once_its_progress_is_received(topics: Topics) -> None:
    patches: list[ManagerPatch] = []
    topics.connections = 0
    connections = ManagerConnections("tests", patches.append)
    try:
        topics.manager_appears()
        time.sleep(0.2)
        assert connections.managers[ROBOT].asked == 0  # type: ignore[attr-defined]
        topics.connections = 1
        wait_until(lambda: len(patches) == 3)
    finally:
        connections.close()


@pytest.mark.parametrize("days", [-1, 1])
def test_ticks_stay_in_order_when_the_clock_is_set_by_a_day(
    topics: Topics, monkeypatch: pytest.MonkeyPatch, days: int
) -> None:
    wall, elapsed, patches = 1e9, 0.0, list[Any]()
    monkeypatch.setattr(now, "_wall", lambda: wall + elapsed)
    monkeypatch.setattr(now, "_monotonic", lambda: elapsed)
    monkeypatch.setattr(now, "_last", 0.0)
    monkeypatch.setattr(now, "_at", 0.0)
    monkeypatch.setattr(Manager, "read_tasks", lambda *_: [])
    connections = ManagerConnections("tests", patches.append)
    topics.manager_appears()
    for _ in range(6):
        topics.callbacks[f"{ROBOT}/monitor"](SimpleNamespace(progress=[root(1, RUNNING)]))
        elapsed += 1.0
        wall += days * 86_400.0 * (elapsed == 3.0)
    connections.close()
    stamps = [patch.stamp for patch in patches if isinstance(patch, TaskProgress)]
    steps = [later - earlier for earlier, later in pairwise(stamps)]
    assert steps == [1.0, 1.0, 1.0 + max(0, days) * 86_400.0, 1.0, 1.0]
