"""News reach those who want to hear of them, without holding the window up."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from skiros2_gui.core.events import ConnectionChanged, ManagersChanged, Progressed
from skiros2_gui.core.inbox import Inbox
from skiros2_gui.core.window import Window
from skiros2_gui.testing.at_once import make_window
from skiros2_gui.testing.local_system import LocalSystem


@pytest.fixture
def inbox() -> Inbox:
    return Inbox(lambda: None)


@pytest.fixture
def window(inbox: Inbox) -> Window:
    made = make_window(lambda _: LocalSystem(inbox))
    return Window(made.system, made.jobs, made.problems, inbox)


def test_each_kind_of_news_reaches_those_who_want_it(window: Window, inbox: Inbox) -> None:
    heard: list[object] = []
    window.subscribe(ConnectionChanged, heard.append)
    window.subscribe(ConnectionChanged, lambda _: heard.append("again"))
    inbox.put(ManagersChanged())
    inbox.put(ConnectionChanged())
    assert not window.take_news()
    assert heard == [ConnectionChanged(), "again"]


def test_what_takes_too_long_goes_on_later_in_order(window: Window, inbox: Inbox) -> None:
    heard: list[float] = []
    window.subscribe(Progressed, lambda event: heard.append(event.stamp))
    for stamp in range(3):
        inbox.put(Progressed("/robot", [SimpleNamespace(id=1)], stamp))
    assert window.take_news(budget=0.0)
    assert heard == [0]
    inbox.put(Progressed("/robot", [SimpleNamespace(id=1)], 3))
    assert not window.take_news()
    assert heard == [0, 1, 2, 3]


def test_what_one_makes_of_news_does_not_keep_it_from_others(window: Window, inbox: Inbox) -> None:
    heard: list[object] = []
    window.subscribe(ManagersChanged, lambda _: 1 // 0)
    window.subscribe(ManagersChanged, heard.append)
    inbox.put(ManagersChanged())
    window.take_news()
    assert heard == [ManagersChanged()]
    assert window.problems.newest is not None
    assert "ZeroDivisionError" in window.problems.newest.text
