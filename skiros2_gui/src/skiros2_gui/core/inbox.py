"""What other threads have heard, until the window's thread has time for it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from skiros2_gui.core.events import ConnectionChanged, Event, ManagersChanged, Progressed, WorldChanged

#: So many states of one task are kept for one batch; of more, those in between are left out, oldest first.
MOST_STATES = 20

#: So many changes of the scene are told one by one in one batch; of more it is told that all may be other.
MOST_CHANGES = 5000


class Inbox:
    """Takes events from any thread, made into few.

    In a batch there is at most one `WorldChanged` and one event of each kind without content; of each task the states
    in their order.

    :param wake: called, in the thread that brings the first event after a batch, to have the next one taken.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._changes: list[WorldChanged] = []
        self._count = 0
        self._tasks: dict[tuple[str, int], deque[Progressed]] = {}
        self._others: dict[Event, None] = {}
        self._is_empty = True

    def put(self, event: Event) -> None:
        """Takes an event. Any thread; returns at once."""
        with self._lock:
            if isinstance(event, WorldChanged):
                self._changes.append(event)
                self._count += len(event.changes)
                if self._count > MOST_CHANGES:
                    ontology = any(e.ontology for e in self._changes)
                    self._changes, self._count = [WorldChanged((), True, ontology)], 0
            elif isinstance(event, Progressed):
                if not event.nodes:
                    return
                key = (event.manager, event.task)
                self._tasks.setdefault(key, deque(maxlen=MOST_STATES)).append(event)
            else:
                self._others[event] = None
            was_empty, self._is_empty = self._is_empty, False
        if was_empty:
            self._wake()

    def take(self) -> list[Event]:
        """The batch: first what is up, then the managers, the scene, and the tasks. In the window's thread."""
        with self._lock:
            changes, self._changes, self._count = self._changes, [], 0
            tasks, self._tasks = self._tasks, {}
            others, self._others = self._others, {}
            self._is_empty = True
        batch: list[Event] = sorted(others, key=_rank)
        if changes:
            batch.append(_joined(changes))
        batch += [event for states in tasks.values() for event in states]
        return batch


def _joined(events: list[WorldChanged]) -> WorldChanged:
    if len(events) == 1:
        return events[0]
    return WorldChanged(
        tuple(change for event in events for change in event.changes),
        any(event.is_new for event in events),
        any(event.ontology for event in events),
    )


def _rank(event: Event) -> int:
    order = (ConnectionChanged, ManagersChanged)
    return order.index(type(event)) if type(event) in order else len(order)
