"""A thread that ticks tasks."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from skiros2_common.core.abstract_skill import State
from skiros2_skill.core.runtime.task import Task

log = logging.getLogger(__name__)

#: So many ticks within one period may be asked for by changes and by skills; a task that wakes itself must not spin.
WAKES = 10
_WARN_AGAIN = 60.0  # s between two warnings about the same slow hook


@dataclass(eq=False)
class Scheduled:
    """A task as the workers know it.

    :param told: when its progress was told last (s, monotonic).
    :param woken: whether it is to be ticked at once.
    :param wakes: the ticks beside those of the grid since the last slot.
    """

    task: Task
    told: float = 0.0
    woken: bool = True
    wakes: int = 0
    warned: dict[str, float] = field(default_factory=dict)

    @property
    def due(self) -> bool:
        return self.woken and self.task.wants_tick


@dataclass(eq=False)
class Tick:
    """A tick that is under way.

    :param since: when it began (s, monotonic).
    :param places: where it was seen, and how often.
    :param hook, hook_since: the hook that was being called when it was looked at last, and since when (s, monotonic).
    """

    scheduled: Scheduled
    since: float
    places: Counter[str] = field(default_factory=Counter)
    hook: str = ""
    hook_since: float = 0.0


@dataclass
class Pace:
    """How tasks are ticked, and who is told.

    :param period: from slot to slot of the grid (s).
    :param keep_alive: progress is told at least so often (s).
    """

    period: float
    keep_alive: float
    on_tick: Callable[[], None]
    on_progress: Callable[[Task], None]


class Worker:
    """Ticks its tasks in each slot of a grid of time, and each one that is woken at once.

    A slot that is late is made up for, several are not: ticks neither drift nor come in a burst. `now` and the tasks
    are shared with other threads, under `lock`, on which the worker waits; no hook and no callback is called under it.

    :param lock: of all workers of a ticker.
    :param ended: called, under the lock, with a task that has ended.
    :param first: whether it ticks all tasks that have no worker of their own.
    """

    def __init__(
        self, pace: Pace, lock: threading.Condition, ended: Callable[[Scheduled], None], first: bool = True
    ) -> None:
        self._pace = pace
        self._lock = lock
        self._ended = ended
        self.first = first
        self.tasks: dict[int, Scheduled] = {}
        self.now: Tick | None = None
        self.stopping = False
        self._due = time.monotonic()
        self.thread = threading.Thread(target=self._run, name="ticker", daemon=True)
        self.thread.start()

    def add(self, scheduled: Scheduled) -> None:
        """Ticks a task from now on. Under the lock."""
        if not self.tasks:
            self._due = time.monotonic()
        self.tasks[scheduled.task.id] = scheduled
        self._lock.notify_all()

    def _run(self) -> None:
        while True:
            with self._lock:
                found = self._wait()
            if found is None:
                return
            batch, is_slot = found
            ticked = [self._tick(scheduled) for scheduled in batch]
            if is_slot and self.first and any(ticked):
                _call(self._pace.on_tick)

    def _wait(self) -> tuple[list[Scheduled], bool] | None:
        """What is to be ticked, and whether that is a slot of the grid; None at the end."""
        while True:
            if not self.tasks and (self.stopping or not self.first):
                return None
            now = time.monotonic()
            if now >= self._due and self.tasks:
                late = (now - self._due) // self._pace.period
                self._due += max(1.0, late) * self._pace.period
                batch = list(self.tasks.values())
                for scheduled in batch:
                    scheduled.woken, scheduled.wakes = True, 0
                return batch, True
            woken = [scheduled for scheduled in self.tasks.values() if scheduled.due]
            if woken:
                return woken, False
            self._lock.wait(self._due - now if self.tasks else None)

    def _tick(self, scheduled: Scheduled) -> bool:
        """Ticks a task if it is still this worker's and wants it. Returns whether it was ticked."""
        task = scheduled.task
        with self._lock:
            if self.tasks.get(task.id) is not scheduled:
                return False
            wanted = scheduled.due
            scheduled.woken = False
            self.now = tick = Tick(scheduled, time.monotonic())
        if wanted:
            task.tick()
        with self._lock:
            self.now = None
            if wanted and task.paused:
                self._lock.notify_all()
            if self.tasks.get(task.id) is not scheduled:
                return True  # it was taken away, because a hook did not return
            if task.ended.is_set():
                del self.tasks[task.id]
                self._ended(scheduled)
                self._lock.notify_all()
        self._tell(scheduled)
        self._warn(tick)
        return wanted

    def _tell(self, scheduled: Scheduled) -> None:
        task = scheduled.task
        if task.state is State.Idle:
            return  # it is still being made
        now = time.monotonic()
        if task.take_changed() or task.ended.is_set() or now - scheduled.told >= self._pace.keep_alive:
            scheduled.told = now
            _call(lambda: self._pace.on_progress(task))

    def _warn(self, tick: Tick) -> None:
        """Reports a tick that took longer than a period, once a minute for each place."""
        now = time.monotonic()
        if now - tick.since <= self._pace.period:
            return
        place = tick.places.most_common(1)[0][0] if tick.places else "many nodes"
        warned = tick.scheduled.warned
        if now - warned.get(place, -_WARN_AGAIN) >= _WARN_AGAIN:
            warned[place] = now
            log.warning(
                "task %s: a tick took %.3f s, longer than the %.3f s between two; most of it was spent in %s",
                tick.scheduled.task.id, now - tick.since, self._pace.period, place,
            )  # fmt: skip


def _call(callback: Callable[[], None]) -> None:
    """What a callback raises is logged: it must not end the thread."""
    try:
        callback()
    except Exception:
        log.exception("a callback of the ticker raised")
