"""Calls that take time, carried out beside the thread that draws the window."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_gui.core.problems import Problems

log = logging.getLogger(__name__)

Result = TypeVar("Result")

#: So many calls are under way at once; others wait for their turn.
MOST_AT_ONCE = 16


@dataclass(eq=False)
class _Job:
    call: Callable[[], Any]
    done: Callable[[Any], None] | None
    failed: Callable[[Exception], None] | None
    what: str
    lane: str
    result: Any = None
    error: Exception | None = None


class Jobs:
    """Runs calls in worker threads and delivers what came of them in the window's thread.

    All methods but the workers' own are called in the window's thread.

    :param problems: gets the errors that nobody else takes.
    :param wake: called in a worker, when something has ended; has `deliver` called in the window's thread soon.
    """

    def __init__(self, problems: Problems, wake: Callable[[], None]) -> None:
        self._problems = problems
        self._wake = wake
        self._lock = threading.Lock()
        self._ready: deque[_Job] = deque()
        self._lanes: dict[str, deque[_Job]] = {}  # of each lane with a job under way, those that wait for it
        self._ended: deque[_Job] = deque()
        self._under_way: list[_Job] = []  # known to the window's thread alone, in the order of their beginning
        self._free = 0
        self._workers = 0
        self._available = threading.Condition(self._lock)
        self._is_closed = False
        self._busy_hooks: list[Callable[[], None]] = []

    def on_busy(self, hook: Callable[[], None]) -> None:
        """`hook` is called whenever `busy_with` has changed."""
        self._busy_hooks.append(hook)

    @property
    def busy_with(self) -> list[str]:
        """What is under way, in words; those without words are left out."""
        return [job.what for job in self._under_way if job.what]

    def run(
        self,
        call: Callable[[], Result],
        done: Callable[[Result], None] | None = None,
        failed: Callable[[Exception], None] | None = None,
        *,
        what: str = "",
        lane: str = "",
        urgent: bool = False,
    ) -> None:
        """Has a call carried out in a worker thread.

        :param call: touches nothing of the window.
        :param done: called in the window's thread with what it returned.
        :param failed: likewise with the error that it raised; None: the window's error bar shows it.
        :param what: in words, for the busy sign and before an error: "loading the scene". "" shows no busy sign.
        :param lane: calls of one lane are carried out one after the other, in the order in which they came.
        :param urgent: the call begins at once in a thread of its own, in no lane, however many calls are under way.
        """
        if self._is_closed:
            return
        job = _Job(call, done, failed, what, "" if urgent else lane)
        self._under_way.append(job)
        if urgent:
            threading.Thread(target=self._work_at_once, args=(job,), name="urgent window job", daemon=True).start()
        else:
            self._begin(job)
        self._tell_busy()

    def post(self, call: Callable[[], None]) -> None:
        """Has a call made in the window's thread soon. Any thread; calls that are posted keep their order."""
        with self._lock:
            if self._is_closed:
                return
            self._ended.append(_Job(_nothing, lambda _: call(), None, "", ""))
        self._wake()

    def deliver(self) -> None:
        """Hands out what has come of calls."""
        while not self._is_closed:
            with self._lock:
                if not self._ended:
                    return
                job = self._ended.popleft()
            was_run = job in self._under_way
            if was_run:
                self._under_way.remove(job)
            self._hand_out(job)
            if was_run:
                self._tell_busy()

    def close(self) -> None:
        """Drops what waits, and what comes of the calls that are under way; they are not waited for."""
        with self._lock:
            self._is_closed = True
            self._ready.clear()
            self._lanes.clear()
            self._available.notify_all()
        self._under_way.clear()
        self._busy_hooks.clear()

    def _begin(self, job: _Job) -> None:
        with self._lock:
            if job.lane:
                waiting = self._lanes.get(job.lane)
                if waiting is not None:
                    waiting.append(job)
                    return
                self._lanes[job.lane] = deque()
            self._put(job)

    def _put(self, job: _Job) -> None:
        """Gives a job to a worker. Under the lock."""
        self._ready.append(job)
        if self._free < len(self._ready) and self._workers < MOST_AT_ONCE:
            self._workers += 1
            threading.Thread(target=self._work, name=f"window job {self._workers}", daemon=True).start()
        self._available.notify()

    def _work(self) -> None:
        while True:
            with self._lock:
                self._free += 1
                self._available.wait_for(lambda: self._ready or self._is_closed)
                self._free -= 1
                if self._is_closed:
                    return
                job = self._ready.popleft()
            self._work_at_once(job)

    def _work_at_once(self, job: _Job) -> None:
        """Carries out one call in this thread, and gives the next one of its lane to a worker."""
        self._carry_out(job)
        with self._lock:
            if self._is_closed:
                return
            self._ended.append(job)
            waiting = self._lanes.get(job.lane)
            if waiting:
                self._put(waiting.popleft())
            elif waiting is not None:
                del self._lanes[job.lane]
        self._wake()

    @staticmethod
    def _carry_out(job: _Job) -> None:
        try:
            job.result = job.call()
        except Exception as error:  # whatever it is, the window shows it
            job.error = error
        except SystemExit as error:  # of a library's code
            job.error = RuntimeError(f"the code that was called wanted to end the program ({error})")

    def _hand_out(self, job: _Job) -> None:
        try:
            if job.error is None:
                if job.done is not None:
                    job.done(job.result)
            elif job.failed is not None:
                job.failed(job.error)
            else:
                self._problems.tell(job.what, job.error)
        except FOREIGN_ERRORS as error:
            log.exception("what came of %r could not be shown", job.what or job.call)
            self._problems.tell(f"showing what came of {job.what or 'a call'}", error)

    def _tell_busy(self) -> None:
        for hook in self._busy_hooks:
            hook()


def _nothing() -> None:
    """What is posted has been done already."""
