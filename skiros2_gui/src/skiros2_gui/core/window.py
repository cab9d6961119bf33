"""What the parts of the window share: the system, jobs, problems, and who wants to hear of what."""

from __future__ import annotations

import logging
import math
import time
from collections import defaultdict, deque
from collections.abc import Callable
from typing import Any, TypeVar

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_gui.core.events import Event
from skiros2_gui.core.inbox import Inbox
from skiros2_gui.core.jobs import Jobs
from skiros2_gui.core.problems import Problems
from skiros2_gui.core.system import System

log = logging.getLogger(__name__)

E = TypeVar("E", bound=Event)


class Window:
    """One window. Used in the window's thread alone, but for the inbox.

    :param inbox: what the system puts its news into.
    """

    def __init__(self, system: System, jobs: Jobs, problems: Problems, inbox: Inbox) -> None:
        self.system = system
        self.jobs = jobs
        self.problems = problems
        self._inbox = inbox
        self._untold: deque[Event] = deque()
        self._handlers: defaultdict[type, list[Callable[[Any], None]]] = defaultdict(list)

    def subscribe(self, kind: type[E], handler: Callable[[E], None]) -> None:
        """`handler` is called with each event of that kind, in the window's thread."""
        self._handlers[kind].append(handler)

    def tell(self, event: Event) -> None:
        """Tells an event at once to those who want to hear of it. What one of them raises does not keep it from the
        others."""
        for handler in list(self._handlers[type(event)]):
            try:
                handler(event)
            except FOREIGN_ERRORS as error:
                log.exception("%s could not be shown", type(event).__name__)
                self.problems.tell("showing what is new", error)

    def post(self, event: Event) -> None:
        """Has an event told soon. Any thread."""
        self._inbox.put(event)

    def take_news(self, budget: float = math.inf) -> bool:
        """Tells what has come in. Called 25 times a second at most.

        :param budget: s after which the rest is left for the next call, so that the window answers to the user.
        :returns: whether there is more to tell.
        """
        end = time.perf_counter() + budget
        self._untold += self._inbox.take()
        while self._untold:
            self.tell(self._untold.popleft())
            if time.perf_counter() > end:
                break
        return bool(self._untold)
