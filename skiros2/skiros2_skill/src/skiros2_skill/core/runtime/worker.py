"""A thread that ticks tasks periodically and on request."""

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

#: Maximum number of ticks per period requested by changes and by skills: a task that wakes itself must not spin.
MAX_WAKES = 10
_WARNING_PERIOD = 60.0  # s between two warnings about the same slow hook


@dataclass(eq=False)
class ScheduledTask:
    """A task with its scheduling state.

    :param reported_at: when its progress was last reported (s, monotonic).
    :param woken: whether a tick at once is requested.
    :param wakes: the number of requested ticks in this period.
    :param warned: when a slow hook was last logged, by hook (s, monotonic).
    """

    task: Task
    reported_at: float = 0.0
    woken: bool = True
    wakes: int = 0
    warned: dict[str, float] = field(default_factory=dict)

    @property
    def due(self) -> bool:
        return self.woken and self.task.wants_tick


@dataclass(eq=False)
class Tick:
    """A tick in progress.

    :param since: its start (s, monotonic).
    :param samples: how often the watchdog has seen each hook.
    :param hook, hook_since: the hook at the watchdog's last check, and when it was first seen (s, monotonic).
    """

    scheduled: ScheduledTask
    since: float
    samples: Counter[str] = field(default_factory=Counter)
    hook: str = ""
    hook_since: float = 0.0


@dataclass
class TickSettings:
    """The periods and callbacks of ticking.

    :param period: between periodic ticks (s).
    :param keep_alive: maximum time between reports of a task's progress (s).
    :param on_tick: called after each period.
    :param on_progress: called with a task when its progress is to be reported.
    """

    period: float
    keep_alive: float
    on_tick: Callable[[], None]
    on_progress: Callable[[Task], None]


class Worker:
    """Ticks its tasks once in every period, and woken tasks at once.

    After a delay the schedule skips whole periods: ticks neither drift nor come in a burst. `lock` protects `current`
    and `tasks`; no hook and no callback is called while it is held.

    :param lock: shared by all workers of a scheduler.
    :param ended: called with a task that has ended, while the lock is held.
    :param is_main: whether new tasks go to this worker.
    """

    def __init__(
        self,
        settings: TickSettings,
        lock: threading.Condition,
        ended: Callable[[ScheduledTask], None],
        is_main: bool = True,
    ) -> None:
        self._settings = settings
        self._lock = lock
        self._ended = ended
        self.is_main = is_main
        self.tasks: dict[int, ScheduledTask] = {}
        self.current: Tick | None = None
        self.stopping = False
        self._due = time.monotonic()
        self.thread = threading.Thread(target=self._run, name="task scheduler", daemon=True)
        self.thread.start()

    def add(self, scheduled: ScheduledTask) -> None:
        """Starts ticking a task. The caller holds the lock."""
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
            batch, is_period = found
            ticked = [self._tick(scheduled) for scheduled in batch]
            if is_period and self.is_main and any(ticked):
                _call(self._settings.on_tick)

    def _wait(self) -> tuple[list[ScheduledTask], bool] | None:
        """Waits for the next ticks. Returns the tasks, and whether these are periodic ticks; None at the end."""
        while True:
            if not self.tasks and (self.stopping or not self.is_main):
                return None
            now = time.monotonic()
            if now >= self._due and self.tasks:
                late = (now - self._due) // self._settings.period
                self._due += max(1.0, late) * self._settings.period
                batch = list(self.tasks.values())
                for scheduled in batch:
                    scheduled.woken, scheduled.wakes = True, 0
                return batch, True
            woken = [scheduled for scheduled in self.tasks.values() if scheduled.due]
            if woken:
                return woken, False
            self._lock.wait(self._due - now if self.tasks else None)

    def _tick(self, scheduled: ScheduledTask) -> bool:
        """Ticks a task that still belongs to this worker and is to be ticked. Returns whether it was ticked."""
        task = scheduled.task
        with self._lock:
            if self.tasks.get(task.id) is not scheduled:
                return False
            wanted = scheduled.due
            scheduled.woken = False
            self.current = tick = Tick(scheduled, time.monotonic())
        if wanted:
            task.tick()
        with self._lock:
            self.current = None
            if wanted and task.paused:
                self._lock.notify_all()
            if self.tasks.get(task.id) is not scheduled:
                return True  # its hook was abandoned: another worker has it
            if task.ended.is_set():
                del self.tasks[task.id]
                self._ended(scheduled)
                self._lock.notify_all()
        self._report(scheduled)
        self._warn(tick)
        return wanted

    def _report(self, scheduled: ScheduledTask) -> None:
        task = scheduled.task
        if task.state is State.Idle:
            return  # not started yet
        now = time.monotonic()
        if task.update_revision() or task.ended.is_set() or now - scheduled.reported_at >= self._settings.keep_alive:
            scheduled.reported_at = now
            _call(lambda: self._settings.on_progress(task))

    def _warn(self, tick: Tick) -> None:
        """Logs a tick that took longer than a period, at most once a minute for each hook."""
        now = time.monotonic()
        if now - tick.since <= self._settings.period:
            return
        hook = tick.samples.most_common(1)[0][0] if tick.samples else "many nodes"
        warned = tick.scheduled.warned
        if now - warned.get(hook, -_WARNING_PERIOD) >= _WARNING_PERIOD:
            warned[hook] = now
            log.warning(
                "task %s: a tick took %.3f s, longer than the period of %.3f s; most of it was spent in %s",
                tick.scheduled.task.id, now - tick.since, self._settings.period, hook,
            )  # fmt: skip


def _call(callback: Callable[[], None]) -> None:
    """Calls a callback and logs exceptions, which must not end the thread."""
    try:
        callback()
    except Exception:
        log.exception("a callback of the scheduler raised")
