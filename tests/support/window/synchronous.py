"""Jobs that run synchronously, for tests of presenters."""

from __future__ import annotations

from collections.abc import Callable

from skiros2_gui.app.events import EventQueue
from skiros2_gui.app.jobs import Job, Jobs
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.system import System
from skiros2_gui.app.window import Window


class SynchronousJobs(Jobs):
    """Runs calls and their callbacks within `run`. Errors of callbacks are raised.

    :param deferred: delays calls until `release`, to test the state while they run.
    """

    def __init__(self, problems: Problems, deferred: bool = False) -> None:
        super().__init__(problems, lambda: None)
        self.deferred = deferred
        self._waiting: list[Job] = []

    def release(self) -> None:
        """Runs the delayed calls."""
        waiting, self._waiting = self._waiting, []
        for job in waiting:
            self._now(job)

    def _start(self, job: Job) -> None:
        if self.deferred:
            self._waiting.append(job)
        else:
            self._now(job)

    def _now(self, job: Job) -> None:
        self._work(job)
        self.deliver()

    def _call_back(self, job: Job) -> None:
        self._conclude(job)


def make_window(connect: Callable[[EventQueue], System]) -> Window:
    """Returns a window without widgets. Events of the system are published by `process_events`."""
    problems = Problems()
    event_queue = EventQueue(lambda: None)
    return Window(connect(event_queue), SynchronousJobs(problems), problems, event_queue)
