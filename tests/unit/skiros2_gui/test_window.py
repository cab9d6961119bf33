"""The event bus of the window."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from skiros2_gui.app.events import ConnectionChanged, EventQueue, ManagersChanged
from skiros2_gui.app.window import Window
from skiros2_live.core.patch import TaskProgress
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window


@pytest.fixture
def event_queue() -> EventQueue:
    return EventQueue(lambda: None)


@pytest.fixture
def window(event_queue: EventQueue) -> Window:
    made = make_window(lambda _: LocalSystem(event_queue))
    return Window(made.system, made.jobs, made.problems, event_queue)


def test_events_reach_their_subscribers(window: Window, event_queue: EventQueue) -> None:
    received: list[object] = []
    window.subscribe(ConnectionChanged, received.append)
    window.subscribe(ConnectionChanged, lambda _: received.append("again"))
    event_queue.put(ManagersChanged())
    event_queue.put(ConnectionChanged())
    assert not window.process_events()
    assert received == [ConnectionChanged(), "again"]


def test_events_beyond_the_budget_are_delivered_later_in_order(window: Window, event_queue: EventQueue) -> None:
    window.process_events()
    received: list[float] = []
    window.subscribe(TaskProgress, lambda event: received.append(event.stamp))
    for stamp in range(3):
        event_queue.put(TaskProgress("/robot", [SimpleNamespace(id=1)], stamp))
    assert window.process_events(budget=0.0)
    assert received == [0]
    event_queue.put(TaskProgress("/robot", [SimpleNamespace(id=1)], 3))
    assert not window.process_events()
    assert received == [0, 1, 2, 3]


def test_failing_handler_does_not_affect_others(window: Window, event_queue: EventQueue) -> None:
    received: list[object] = []
    window.subscribe(ManagersChanged, lambda _: 1 // 0)
    window.subscribe(ManagersChanged, received.append)
    event_queue.put(ManagersChanged())
    window.process_events()
    assert received == [ManagersChanged()]
    assert window.problems.newest is not None
    assert "ZeroDivisionError" in window.problems.newest.text
