"""Blocking calls in worker threads, and a limit of the time spent on repeated work."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_gui.app.problems import Problems

log = logging.getLogger(__name__)

Result = TypeVar("Result")


@dataclass(eq=False)
class Job:
    """A call and its callbacks; see `Jobs.run`."""

    call: Callable[[], Any]
    done: Callable[[Any], None] | None
    failed: Callable[[Exception], None] | None
    activity: str
    queue: str
    result: Any = None
    error: Exception | None = None


class Jobs:
    """Runs calls in worker threads and delivers their results in the window's thread.

    Public methods are called in the window's thread, unless stated otherwise.

    :param problems: gets the errors that no callback takes.
    :param wake: called in a worker when a call has ended; schedules `deliver` in the window's thread.
    """

    def __init__(self, problems: Problems, wake: Callable[[], None]) -> None:
        self._problems = problems
        self._wake = wake
        self._lock = threading.Lock()
        self._queues: dict[str, deque[Job]] = {}  # the waiting jobs of each queue that has a running job
        self._ended: deque[Job] = deque()
        self._running: list[Job] = []  # used by the window's thread only
        self._is_closed = False
        self._busy_hooks: list[Callable[[], None]] = []

    def on_busy(self, hook: Callable[[], None]) -> None:
        """Registers `hook`, which is called whenever `activities` has changed."""
        self._busy_hooks.append(hook)

    @property
    def activities(self) -> list[str]:
        """The descriptions of the running and waiting calls; calls without one are left out."""
        return [job.activity for job in self._running if job.activity]

    def run(
        self,
        call: Callable[[], Result],
        done: Callable[[Result], None] | None = None,
        failed: Callable[[Exception], None] | None = None,
        *,
        activity: str = "",
        queue: str = "",
    ) -> None:
        """Runs a call in a daemon thread of its own, so that the program can end while it hangs.

        :param call: does not access the window.
        :param done: called in the window's thread with the result.
        :param failed: called in the window's thread with the error; None shows it in the error bar.
        :param activity: describes the call for the busy sign and the error bar: "loading the scene"; "" shows no busy
            sign.
        :param queue: calls with the same queue run one at a time, in order; "" runs at once.
        """
        if self._is_closed:
            return
        job = Job(call, done, failed, activity, queue)
        self._running.append(job)
        with self._lock:
            waiting = self._queues.get(queue)
            if waiting is not None:
                waiting.append(job)
            elif queue:
                self._queues[queue] = deque()
        if waiting is None:
            self._start(job)
        self._notify_busy()

    def deliver(self) -> None:
        """Calls the callbacks of the calls that have ended."""
        while not self._is_closed:
            with self._lock:
                if not self._ended:
                    return
                job = self._ended.popleft()
            self._running.remove(job)
            self._call_back(job)
            self._notify_busy()

    def close(self) -> None:
        """Discards waiting calls and all results. Does not wait for running calls."""
        with self._lock:
            self._is_closed = True
            self._queues.clear()
        self._running.clear()
        self._busy_hooks.clear()

    def _start(self, job: Job) -> None:
        """Runs a job and those that wait for it; in a thread of its own."""
        threading.Thread(target=self._work, args=(job,), name=f"window job {job.activity}", daemon=True).start()

    def _work(self, job: Job | None) -> None:
        while job is not None:
            self._run_call(job)
            with self._lock:
                if self._is_closed:
                    return
                self._ended.append(job)
                waiting = self._queues.get(job.queue)
                if not waiting:
                    self._queues.pop(job.queue, None)
                job = waiting.popleft() if waiting else None
            self._wake()

    @staticmethod
    def _run_call(job: Job) -> None:
        try:
            job.result = job.call()
        except Exception as error:  # shown in the window
            job.error = error
        except SystemExit as error:  # raised by a library
            job.error = RuntimeError(f"the call tried to exit the program ({error})")

    def _call_back(self, job: Job) -> None:
        try:
            self._conclude(job)
        except FOREIGN_ERRORS as error:
            log.exception("showing the result of %r failed", job.activity or job.call)
            self._problems.report(f"showing the result of {job.activity or 'a call'}", error)

    def _conclude(self, job: Job) -> None:
        if job.error is None:
            if job.done is not None:
                job.done(job.result)
        elif job.failed is not None:
            job.failed(job.error)
        else:
            self._problems.report(job.activity, job.error)

    def _notify_busy(self) -> None:
        for hook in self._busy_hooks:
            hook()


class Throttle:
    """Keeps repeated work to a share of the time. For one thread.

    :param share: 0 to 1.
    """

    def __init__(self, share: float = 0.1, clock: Callable[[], float] = time.monotonic) -> None:
        self._share = share
        self._clock = clock
        self._began = self._ready_at = -1.0

    @property
    def is_ready(self) -> bool:
        """Whether the work may start again."""
        return self._clock() >= self._ready_at

    def begin(self) -> None:
        """The work starts."""
        self._began = self._clock()

    def end(self) -> None:
        """The work has ended."""
        now = self._clock()
        self._ready_at = now + (now - self._began) * (1.0 / self._share - 1.0)
