"""What the parts of a window share, the list of tasks included: the system, jobs, problems and the event bus."""

from __future__ import annotations

import logging
import math
import time
from collections import defaultdict, deque
from collections.abc import Callable
from typing import Any, TypeVar

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_gui.app.events import Event, EventQueue
from skiros2_gui.app.jobs import Jobs
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.system import System

log = logging.getLogger(__name__)

E = TypeVar("E", bound=Event)


class WindowContext:
    """The context of one window without its list of tasks, which uses it. In the window's thread only, except `post`.

    :param event_queue: the queue that the system puts its events into.
    """

    def __init__(self, system: System, jobs: Jobs, problems: Problems, event_queue: EventQueue) -> None:
        self.system = system
        self.jobs = jobs
        self.problems = problems
        self._event_queue = event_queue
        self._pending: deque[Event] = deque()
        self._handlers: defaultdict[type, list[Callable[[Any], None]]] = defaultdict(list)

    def subscribe(self, kind: type[E], handler: Callable[[E], None]) -> None:
        """Registers `handler` for all events of a kind. It is called in the window's thread."""
        self._handlers[kind].append(handler)

    def publish(self, event: Event) -> None:
        """Publishes an event to its subscribers at once. An exception of one handler does not affect the others."""
        for handler in list(self._handlers[type(event)]):
            try:
                handler(event)
            except FOREIGN_ERRORS as error:
                log.exception("handling %s failed", type(event).__name__)
                self.problems.report(f"handling {type(event).__name__}", error)

    def post(self, event: Event) -> None:
        """Publishes an event later. Any thread."""
        self._event_queue.put(event)

    def process_events(self, budget: float = math.inf) -> bool:
        """Publishes the queued events.

        :param budget: after this time (s) the remaining events are left for the next call.
        :returns: whether events remain.
        """
        end = time.perf_counter() + budget
        self._pending += self._event_queue.take()
        while self._pending:
            self.publish(self._pending.popleft())
            if time.perf_counter() > end:
                break
        return bool(self._pending)
