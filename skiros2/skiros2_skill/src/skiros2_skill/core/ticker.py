"""The thread that ticks all tasks of a manager."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_skill.core.task import MAX_ID, Task

log = logging.getLogger(__name__)

#: Each level of a tree costs about six frames; Python's own limit of 1000 would end trees of 150 levels.
RECURSION_LIMIT = 100_000


class Ticker:
    """Ticks tasks at a fixed rate, in a thread of its own.

    :param rate: ticks per second.
    :param on_tick: called after each round, in the ticking thread.
    :param on_progress: called with a task, in the ticking thread, after each tick in which something changed, at least
        every `keep_alive` seconds, and when the task has ended.
    :param keep_alive: s.
    """

    def __init__(
        self,
        rate: float = 25.0,
        on_tick: Callable[[], None] = lambda: None,
        on_progress: Callable[[Task], None] = lambda task: None,
        keep_alive: float = 1.0,
    ) -> None:
        self._period = 1.0 / rate
        self._on_tick = on_tick
        self._on_progress = on_progress
        self._keep_alive = keep_alive
        self._tasks: dict[int, Task] = {}
        self._told: dict[int, float] = {}
        self._next_id = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="ticker", daemon=True)
        sys.setrecursionlimit(max(sys.getrecursionlimit(), RECURSION_LIMIT))
        self._thread.start()

    # -- from any thread ---------------------------------------------------------------------------------------

    def new_task(self, wmi: Any, author: str) -> Task:
        """A task with an id that no other task has. It is not ticked before `start`."""
        with self._lock:
            while self._next_id in self._tasks:
                self._next_id = (self._next_id + 1) % (MAX_ID + 1)
            task = Task(self._next_id, wmi, author)
            task.waker = self._wake.set
            self._tasks[task.id] = task
            self._next_id = (self._next_id + 1) % (MAX_ID + 1)
            task.pause()
            return task

    def discard(self, task: Task) -> None:
        """Forgets a task that was never started."""
        with self._lock:
            self._tasks.pop(task.id, None)

    def start(self, task_id: int, ticks: int = 0) -> None:
        """Ticks a new or paused task; given a number, pauses it after that many ticks.

        :raises UnknownName: there is no such task.
        :raises Refused: it runs already.
        """
        task = self.get(task_id)
        if not task.paused:
            raise Refused(f"task {task_id} runs already")
        task.resume(ticks)
        self._wake.set()

    def preempt(self, task_id: int) -> None:
        """Ends a task at once.

        :raises UnknownName: there is no such task.
        """
        self.get(task_id).preempt()
        self._wake.set()

    def pause(self, task_id: int) -> None:
        """Stops ticking a task; it keeps its state.

        :raises UnknownName: there is no such task.
        """
        self.get(task_id).pause()

    def get(self, task_id: int) -> Task:
        """The task with that id.

        :raises UnknownName: there is none, or it has ended.
        """
        with self._lock:
            task = self._tasks.get(task_id)
            known = ", ".join(str(i) for i in self._tasks) or "none"
        if task is None:
            raise UnknownName(f"no task {task_id} is here; there are: {known}")
        return task

    def tasks(self) -> list[Task]:
        """The tasks that have not ended."""
        with self._lock:
            return list(self._tasks.values())

    def stop(self, timeout: float = 2.0) -> None:
        """Preempts all tasks, ticks until they have ended, and ends the thread.

        :param timeout: s to wait at most; a hook that does not return is left behind.
        """
        for task in self.tasks():
            task.preempt()
        self._stopped = True
        self._wake.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    # -- the ticking thread ------------------------------------------------------------------------------------

    def _run(self) -> None:
        due = time.monotonic()
        while True:
            tasks = [task for task in self.tasks() if task.wants_tick]
            if self._stopped and not tasks:
                return
            for task in tasks:
                self._tick(task)
            if tasks:
                self._call(self._on_tick)
            for task in self.tasks():
                self._tell(task)
            due = max(due + self._period, time.monotonic())  # a slow round delays the next ones, but does not add up
            self._sleep_until(due if tasks else None)

    def _sleep_until(self, due: float | None) -> None:
        """Until the time comes or somebody wakes the thread; without a time, until somebody does."""
        idle = self._keep_alive if self.tasks() else None
        waiting = idle if due is None else max(0.0, due - time.monotonic())
        self._wake.wait(waiting)
        self._wake.clear()

    def _tick(self, task: Task) -> None:
        task.tick()
        if task.ended.is_set():
            with self._lock:
                self._tasks.pop(task.id, None)
            self._told.pop(task.id, None)
            self._call(lambda: self._on_progress(task))

    def _tell(self, task: Task) -> None:
        now = time.monotonic()
        if task.take_changed() or now - self._told.get(task.id, 0.0) >= self._keep_alive:
            self._told[task.id] = now
            self._call(lambda: self._on_progress(task))

    def _call(self, callback: Callable[[], None]) -> None:
        """What a callback raises is logged: it must not end the thread."""
        try:
            callback()
        except Exception:
            log.exception("a callback of the ticker raised")
