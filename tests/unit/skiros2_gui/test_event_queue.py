"""Events between two batches are compressed and kept in order."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_gui.app.events import (
    MAX_CHANGES,
    MAX_STATES,
    ConnectionChanged,
    EventQueue,
    ManagerConnection,
    ManagersChanged,
    SafetyChanged,
    TaskProgress,
    WorldChanged,
)


@pytest.fixture
def wake_calls() -> list[int]:
    return []


@pytest.fixture
def event_queue(wake_calls: list[int]) -> EventQueue:
    return EventQueue(lambda: wake_calls.append(1))


def progress(task: int, time: float, manager: str = "/robot") -> TaskProgress:
    return TaskProgress(manager, [SimpleNamespace(id=task)], time)


def test_queue_wakes_once_per_batch(event_queue: EventQueue, wake_calls: list[int]) -> None:
    event_queue.put(ManagersChanged())
    event_queue.put(ConnectionChanged())
    assert wake_calls == [1]
    event_queue.take()
    event_queue.put(ConnectionChanged())
    assert wake_calls == [1, 1]


def test_batch_is_ordered_and_has_no_duplicates(event_queue: EventQueue) -> None:
    state = progress(1, 0.0)
    for event in (state, WorldChanged(("a",)), ManagersChanged(), ConnectionChanged(), ManagersChanged()):
        event_queue.put(event)
    assert event_queue.take() == [ConnectionChanged(), ManagersChanged(), WorldChanged(("a",)), state]
    assert event_queue.take() == []


def test_the_last_status_of_a_part_is_the_last_in_its_batch(event_queue: EventQueue) -> None:
    up, down = (ManagerConnection("/robot", is_up) for is_up in (True, False))
    stop = SafetyChanged("/robot", "emergency_stop", "", ("button",), 1.0)
    for event in (up, stop, down, up, stop):
        event_queue.put(event)
    assert event_queue.take() == [down, up, stop, ConnectionChanged(), ManagersChanged()]


def test_scene_changes_are_merged_in_order(event_queue: EventQueue) -> None:
    event_queue.put(WorldChanged(("a", "b")))
    event_queue.put(WorldChanged((), is_reset=True))
    event_queue.put(WorldChanged(("c",), ontology=True))
    assert event_queue.take() == [WorldChanged(("a", "b", "c"), is_reset=True, ontology=True)]


def test_too_many_changes_become_a_reset(event_queue: EventQueue) -> None:
    changes: tuple[Any, ...] = tuple(range(MAX_CHANGES))
    event_queue.put(WorldChanged(changes, ontology=True))
    event_queue.put(WorldChanged(("one more",)))
    event_queue.put(WorldChanged(("later",)))
    assert event_queue.take() == [WorldChanged(("later",), is_reset=True, ontology=True)]


def test_oldest_states_of_a_task_are_discarded(event_queue: EventQueue) -> None:
    for time in range(MAX_STATES + 5):
        event_queue.put(progress(1, time))
    event_queue.put(progress(1, 0.5, "/other"))
    event_queue.put(progress(2, 0.5))
    states = event_queue.take()
    assert [s.stamp for s in states if s.manager == "/robot" and s.task == 1] == list(range(5, MAX_STATES + 5))
    assert {(s.manager, s.task) for s in states} == {("/robot", 1), ("/robot", 2), ("/other", 1)}


def test_progress_without_nodes_is_ignored(event_queue: EventQueue, wake_calls: list[int]) -> None:
    event_queue.put(TaskProgress("/robot", [], 0.0))
    assert event_queue.take() == []
    assert wake_calls == []
