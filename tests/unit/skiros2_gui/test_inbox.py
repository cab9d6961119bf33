"""What comes in between two batches is made into few events, and nothing that matters is lost."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_gui.app.event_queue import MAX_CHANGES, MAX_STATES, EventQueue
from skiros2_gui.app.events import ConnectionChanged, ManagersChanged, TaskProgress, WorldChanged


@pytest.fixture
def woken() -> list[int]:
    return []


@pytest.fixture
def event_queue(woken: list[int]) -> EventQueue:
    return EventQueue(lambda: woken.append(1))


def progress(task: int, time: float, manager: str = "/robot") -> TaskProgress:
    return TaskProgress(manager, [SimpleNamespace(id=task)], time)


def test_it_wakes_once_for_each_batch(event_queue: EventQueue, woken: list[int]) -> None:
    event_queue.put(ManagersChanged())
    event_queue.put(ConnectionChanged())
    assert woken == [1]
    event_queue.take()
    event_queue.put(ConnectionChanged())
    assert woken == [1, 1]


def test_what_is_up_comes_first_and_events_without_content_come_once(event_queue: EventQueue) -> None:
    state = progress(1, 0.0)
    for event in (state, WorldChanged(("a",)), ManagersChanged(), ConnectionChanged(), ManagersChanged()):
        event_queue.put(event)
    assert event_queue.take() == [ConnectionChanged(), ManagersChanged(), WorldChanged(("a",)), state]
    assert event_queue.take() == []


def test_changes_of_the_scene_become_one_event_in_their_order(event_queue: EventQueue) -> None:
    event_queue.put(WorldChanged(("a", "b")))
    event_queue.put(WorldChanged((), is_reset=True))
    event_queue.put(WorldChanged(("c",), ontology=True))
    assert event_queue.take() == [WorldChanged(("a", "b", "c"), is_reset=True, ontology=True)]


def test_a_flood_of_changes_becomes_the_word_that_all_is_other(event_queue: EventQueue) -> None:
    changes: tuple[Any, ...] = tuple(range(MAX_CHANGES))
    event_queue.put(WorldChanged(changes, ontology=True))
    event_queue.put(WorldChanged(("one more",)))
    event_queue.put(WorldChanged(("later",)))
    assert event_queue.take() == [WorldChanged(("later",), is_reset=True, ontology=True)]


def test_the_states_of_each_task_keep_their_order_and_the_oldest_of_too_many_go(event_queue: EventQueue) -> None:
    for time in range(MAX_STATES + 5):
        event_queue.put(progress(1, time))
    event_queue.put(progress(1, 0.5, "/other"))
    event_queue.put(progress(2, 0.5))
    states = event_queue.take()
    assert [s.stamp for s in states if s.manager == "/robot" and s.task == 1] == list(range(5, MAX_STATES + 5))
    assert {(s.manager, s.task) for s in states} == {("/robot", 1), ("/robot", 2), ("/other", 1)}


def test_progress_without_nodes_is_no_news(event_queue: EventQueue, woken: list[int]) -> None:
    event_queue.put(TaskProgress("/robot", [], 0.0))
    assert event_queue.take() == []
    assert woken == []
