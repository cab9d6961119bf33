"""Jobs that run synchronously, for tests of presenters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from skiros2_gui.app.event_queue import EventQueue
from skiros2_gui.app.jobs import Jobs
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.system import System
from skiros2_gui.app.window import Window

Result = TypeVar("Result")


class SynchronousJobs(Jobs):
    """Runs calls and their callbacks within `run`.

    :param deferred: delays calls until `release`, to test the state while they run.
    """

    def __init__(self, problems: Problems, deferred: bool = False) -> None:
        super().__init__(problems, lambda: None)
        self.deferred = deferred
        self._waiting: list[Callable[[], None]] = []

    def run(
        self,
        call: Callable[[], Result],
        done: Callable[[Result], None] | None = None,
        failed: Callable[[Exception], None] | None = None,
        *,
        activity: str = "",
        queue: str = "",
        urgent: bool = False,
    ) -> None:
        if self.deferred:
            self._waiting.append(lambda: self._now(call, done, failed, activity))
        else:
            self._now(call, done, failed, activity)

    def post(self, call: Callable[[], None]) -> None:
        call()

    def release(self) -> None:
        """Runs the delayed calls."""
        waiting, self._waiting = self._waiting, []
        for job in waiting:
            job()

    def _now(
        self,
        call: Callable[[], Result],
        done: Callable[[Result], None] | None,
        failed: Callable[[Exception], None] | None,
        activity: str,
    ) -> None:
        try:
            result = call()
        except Exception as error:
            if failed is None:
                self._problems.report(activity, error)
            else:
                failed(error)
            return
        if done is not None:
            done(result)


def make_window(connect: Callable[[EventQueue], System]) -> Window:
    """Returns a window without widgets. Events of the system are published by `process_events`."""
    problems = Problems()
    event_queue = EventQueue(lambda: None)
    return Window(connect(event_queue), SynchronousJobs(problems), problems, event_queue)
