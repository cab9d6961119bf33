"""What comes in between two batches is made into few events, and nothing that matters is lost."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_gui.core.events import ConnectionChanged, ManagersChanged, Progressed, WorldChanged
from skiros2_gui.core.inbox import MOST_CHANGES, MOST_STATES, Inbox


@pytest.fixture
def woken() -> list[int]:
    return []


@pytest.fixture
def inbox(woken: list[int]) -> Inbox:
    return Inbox(lambda: woken.append(1))


def progress(task: int, time: float, manager: str = "/robot") -> Progressed:
    return Progressed(manager, [SimpleNamespace(id=task)], time)


def test_it_wakes_once_for_each_batch(inbox: Inbox, woken: list[int]) -> None:
    inbox.put(ManagersChanged())
    inbox.put(ConnectionChanged())
    assert woken == [1]
    inbox.take()
    inbox.put(ConnectionChanged())
    assert woken == [1, 1]


def test_what_is_up_comes_first_and_events_without_content_come_once(inbox: Inbox) -> None:
    state = progress(1, 0.0)
    for event in (state, WorldChanged(("a",)), ManagersChanged(), ConnectionChanged(), ManagersChanged()):
        inbox.put(event)
    assert inbox.take() == [ConnectionChanged(), ManagersChanged(), WorldChanged(("a",)), state]
    assert inbox.take() == []


def test_changes_of_the_scene_become_one_event_in_their_order(inbox: Inbox) -> None:
    inbox.put(WorldChanged(("a", "b")))
    inbox.put(WorldChanged((), is_new=True))
    inbox.put(WorldChanged(("c",), ontology=True))
    assert inbox.take() == [WorldChanged(("a", "b", "c"), is_new=True, ontology=True)]


def test_a_flood_of_changes_becomes_the_word_that_all_is_other(inbox: Inbox) -> None:
    changes: tuple[Any, ...] = tuple(range(MOST_CHANGES))
    inbox.put(WorldChanged(changes, ontology=True))
    inbox.put(WorldChanged(("one more",)))
    inbox.put(WorldChanged(("later",)))
    assert inbox.take() == [WorldChanged(("later",), is_new=True, ontology=True)]


def test_the_states_of_each_task_keep_their_order_and_the_oldest_of_too_many_go(inbox: Inbox) -> None:
    for time in range(MOST_STATES + 5):
        inbox.put(progress(1, time))
    inbox.put(progress(1, 0.5, "/other"))
    inbox.put(progress(2, 0.5))
    states = inbox.take()
    assert [s.stamp for s in states if s.manager == "/robot" and s.task == 1] == list(range(5, MOST_STATES + 5))
    assert {(s.manager, s.task) for s in states} == {("/robot", 1), ("/robot", 2), ("/other", 1)}


def test_progress_without_nodes_is_no_news(inbox: Inbox, woken: list[int]) -> None:
    inbox.put(Progressed("/robot", [], 0.0))
    assert inbox.take() == []
    assert woken == []
