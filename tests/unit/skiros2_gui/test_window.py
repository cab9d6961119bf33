"""News reach those who want to hear of them, without holding the window up."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from skiros2_gui.app.event_queue import EventQueue
from skiros2_gui.app.events import ConnectionChanged, ManagersChanged, TaskProgress
from skiros2_gui.app.window import Window
from skiros2_gui.testing.local_system import LocalSystem
from skiros2_gui.testing.synchronous import make_window


@pytest.fixture
def event_queue() -> EventQueue:
    return EventQueue(lambda: None)


@pytest.fixture
def window(event_queue: EventQueue) -> Window:
    made = make_window(lambda _: LocalSystem(event_queue))
    return Window(made.system, made.jobs, made.problems, event_queue)


def test_each_kind_of_news_reaches_those_who_want_it(window: Window, event_queue: EventQueue) -> None:
    heard: list[object] = []
    window.subscribe(ConnectionChanged, heard.append)
    window.subscribe(ConnectionChanged, lambda _: heard.append("again"))
    event_queue.put(ManagersChanged())
    event_queue.put(ConnectionChanged())
    assert not window.process_events()
    assert heard == [ConnectionChanged(), "again"]


def test_what_takes_too_long_goes_on_later_in_order(window: Window, event_queue: EventQueue) -> None:
    heard: list[float] = []
    window.subscribe(TaskProgress, lambda event: heard.append(event.stamp))
    for stamp in range(3):
        event_queue.put(TaskProgress("/robot", [SimpleNamespace(id=1)], stamp))
    assert window.process_events(budget=0.0)
    assert heard == [0]
    event_queue.put(TaskProgress("/robot", [SimpleNamespace(id=1)], 3))
    assert not window.process_events()
    assert heard == [0, 1, 2, 3]


def test_what_one_makes_of_news_does_not_keep_it_from_others(window: Window, event_queue: EventQueue) -> None:
    heard: list[object] = []
    window.subscribe(ManagersChanged, lambda _: 1 // 0)
    window.subscribe(ManagersChanged, heard.append)
    event_queue.put(ManagersChanged())
    window.process_events()
    assert heard == [ManagersChanged()]
    assert window.problems.newest is not None
    assert "ZeroDivisionError" in window.problems.newest.text
