"""A queue of events between other threads and the window's thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from skiros2_gui.app.events import ConnectionChanged, Event, ManagersChanged, TaskProgress, WorldChanged

#: States of one task in a batch; of more, the oldest are discarded.
MAX_STATES = 20

#: Changes of the scene in a batch; more are replaced with one event that resets the scene.
MAX_CHANGES = 5000


class EventQueue:
    """Collects events of any thread in batches and compresses them.

    A batch has at most one `WorldChanged` and one event of each kind without content; the states of each task keep
    their order.

    :param wake: called in the thread that puts the first event after a batch; schedules a call of `take`.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._changes: list[WorldChanged] = []
        self._count = 0
        self._tasks: dict[tuple[str, int], deque[TaskProgress]] = {}
        self._plain_events: dict[Event, None] = {}
        self._is_empty = True

    def put(self, event: Event) -> None:
        """Adds an event. Any thread; does not block."""
        with self._lock:
            if isinstance(event, WorldChanged):
                self._changes.append(event)
                self._count += len(event.changes)
                if self._count > MAX_CHANGES:
                    ontology = any(e.ontology for e in self._changes)
                    self._changes, self._count = [WorldChanged((), True, ontology)], 0
            elif isinstance(event, TaskProgress):
                if not event.nodes:
                    return
                key = (event.manager, event.task)
                self._tasks.setdefault(key, deque(maxlen=MAX_STATES)).append(event)
            else:
                self._plain_events[event] = None
            was_empty, self._is_empty = self._is_empty, False
        if was_empty:
            self._wake()

    def take(self) -> list[Event]:
        """Returns and clears the batch: connections, managers, the scene, tasks. In the window's thread."""
        with self._lock:
            changes, self._changes, self._count = self._changes, [], 0
            tasks, self._tasks = self._tasks, {}
            plain_events, self._plain_events = self._plain_events, {}
            self._is_empty = True
        batch: list[Event] = sorted(plain_events, key=_rank)
        if changes:
            batch.append(_joined(changes))
        batch += [event for states in tasks.values() for event in states]
        return batch


def _joined(events: list[WorldChanged]) -> WorldChanged:
    if len(events) == 1:
        return events[0]
    return WorldChanged(
        tuple(change for event in events for change in event.changes),
        any(event.is_reset for event in events),
        any(event.ontology for event in events),
    )


def _rank(event: Event) -> int:
    order = (ConnectionChanged, ManagersChanged)
    return order.index(type(event)) if type(event) in order else len(order)
