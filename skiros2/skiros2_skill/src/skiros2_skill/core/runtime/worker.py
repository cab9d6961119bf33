"""The threads that tick tasks, and the watchdog that finds slow hooks and hooks that do not return."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
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

    :param started: whether it has been started.
    :param reported_at: when its progress was last reported (s, monotonic).
    :param woken: whether a tick at once is requested.
    :param wakes: the number of requested ticks in this period.
    :param warned: when a slow hook was last logged, by hook (s, monotonic).
    """

    task: Task
    started: bool = False
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
        #: Tasks that were preempted while others are ticked: ticked next.
        self.first: deque[ScheduledTask] = deque()
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
            ticked = []
            for scheduled in batch:
                ticked.append(self._tick(scheduled))
                while self.first:
                    ticked.append(self._tick(self.first.popleft()))
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
                self._due += (late + 1.0) * self._settings.period
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
        if task.state is State.Idle and not scheduled.started:
            return
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


_SLOW_TICK = 0.1  # s after which the other tasks move to a new thread
_LONGEST_WAIT = 0.01  # s that a task which is to stop waits for the tick of another one
_MAX_POLL_PERIOD = 0.02  # s


class Watchdog:
    """Creates the workers and checks them several times per period, in a thread of its own.

    A task with a slow tick keeps its thread from then on, and the other tasks move to a new one. So one thread does all
    the work unless a hook blocks it. When a hook of a preempted task does not return in time, it is abandoned with its
    thread and instance, and another thread ends the task.

    :param lock: protects the workers and scheduled tasks; never held for long.
    :param ended: called with a task that has ended, while the lock is held.
    :param timeout: s that the skills of a preempted task have to end.
    :param hook_timeout: s that each hook of such a task has.
    """

    def __init__(
        self,
        settings: TickSettings,
        lock: threading.Condition,
        ended: Callable[[ScheduledTask], None],
        timeout: float,
        hook_timeout: float,
    ) -> None:
        self._settings = settings
        self._lock = lock
        self._ended = ended
        self._timeout = timeout
        self._hook_timeout = hook_timeout
        self._poll_period = min(settings.period / 4, _MAX_POLL_PERIOD)
        self._stopping = False
        self._sleep = threading.Event()
        #: The worker that gets new tasks.
        self.main = Worker(settings, lock, ended)
        self._workers = [self.main]
        self._thread = threading.Thread(target=self._run, name="task watchdog", daemon=True)
        self._thread.start()

    # -- from any thread, which holds the lock -------------------------------------------------------------------

    def limit_timeouts(self, timeout: float) -> None:
        """Reduces the timeouts to at most this one (s)."""
        self._timeout = min(self._timeout, timeout)
        self._hook_timeout = min(self._hook_timeout, timeout)

    def ticked_by_caller(self) -> ScheduledTask | None:
        """The task that the calling thread is ticking."""
        thread = threading.current_thread()
        ticks = (worker.current for worker in self._workers if worker.thread is thread)
        return next((tick.scheduled for tick in ticks if tick is not None), None)

    def is_ticked(self, scheduled: ScheduledTask) -> bool:
        """Whether a tick of the task is in progress."""
        ticks = [w.current for w in self._workers if w.tasks.get(scheduled.task.id) is scheduled]
        return any(tick is not None and tick.scheduled is scheduled for tick in ticks)

    def remove(self, scheduled: ScheduledTask) -> None:
        """Stops ticking a task."""
        for worker in self._workers:
            if worker.tasks.get(scheduled.task.id) is scheduled:
                del worker.tasks[scheduled.task.id]

    def put_first(self, scheduled: ScheduledTask) -> None:
        """Lets a preempted task stop before other tasks are ticked."""
        for worker in self._workers:
            current = worker.current
            if worker.tasks.get(scheduled.task.id) is scheduled and current and current.scheduled is not scheduled:
                worker.first.append(scheduled)

    # -- the end -----------------------------------------------------------------------------------------------

    def stop(self, seconds: float) -> None:
        """Waits until all tasks have ended and ends the threads.

        :param seconds: maximum time to wait.
        """
        with self._lock:
            if self.ticked_by_caller() is None:
                self._lock.wait_for(lambda: not any(worker.tasks for worker in self._workers), seconds)
            for worker in self._workers:
                worker.stopping = True
            remaining = [s.task.id for worker in self._workers for s in worker.tasks.values()]
            threads = [w.thread for w in self._workers if w.current is None and not w.tasks]
            self._stopping = True
            self._lock.notify_all()
        self._sleep.set()
        if remaining:
            log.error("these tasks have not ended within %.1f s: %s", seconds, ", ".join(map(str, remaining)))
        for thread in [*threads, self._thread]:
            if thread is not threading.current_thread():
                thread.join(seconds)

    # -- the watching thread -----------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            with self._lock:
                self._lock.wait_for(lambda: self._stopping or any(worker.tasks for worker in self._workers))
                if self._stopping:
                    return
                self._workers = [w for w in self._workers if w is self.main or w.tasks or w.current is not None]
                warnings = [text for worker in list(self._workers) for text in self._check(worker)]
            for text in warnings:
                log.warning("%s", text)
            self._sleep.wait(self._poll_period)

    def _check(self, worker: Worker) -> list[str]:
        """Checks a worker. Returns warnings to log."""
        now = time.monotonic()
        warnings = []
        tick = worker.current
        if tick is not None:
            age = now - tick.since
            hook = tick.scheduled.task.current_hook
            if hook != tick.hook:
                tick.hook, tick.hook_since = hook, now
            if age > self._settings.period / 2 and hook:
                tick.samples[hook] += 1
            limit = _LONGEST_WAIT if worker.first else max(_SLOW_TICK, 2 * self._settings.period)
            if worker is self.main and age > limit:
                self._move_other_tasks(worker, tick)
                warnings.append(
                    f"task {tick.scheduled.task.id}: {hook or 'a tick'} has run for {age:.1f} s; "
                    "other tasks moved to a new thread"
                )
        for scheduled in list(worker.tasks.values()):
            grace_start = scheduled.task.grace_start
            if grace_start is None:
                continue
            if tick is not None and tick.scheduled is scheduled:
                if tick.hook and now - max(grace_start, tick.hook_since) >= self._hook_timeout:
                    warnings += self._abandon(worker, tick, now)
            elif now - grace_start >= self._timeout:
                scheduled.task.abandon_ending(now)
                scheduled.woken = True
                self._lock.notify_all()
        return warnings

    def _move_other_tasks(self, worker: Worker, tick: Tick) -> None:
        """Moves all tasks of a worker but the one that it is ticking to a new worker."""
        others = [s for s in worker.tasks.values() if s is not tick.scheduled]
        worker.is_main = False
        self.main = Worker(self._settings, self._lock, self._ended)
        self.main.stopping = worker.stopping
        self._workers.append(self.main)
        for scheduled in others:
            del worker.tasks[scheduled.task.id]
            scheduled.woken = True
            self.main.add(scheduled)

    def _abandon(self, worker: Worker, tick: Tick, now: float) -> list[str]:
        """Abandons the hook of a tick and moves the task to another worker, unless the hook has just returned."""
        if worker is self.main:
            self._move_other_tasks(worker, tick)
        reason = tick.scheduled.task.abandon_hook(now, now - tick.since)
        if not reason:
            return []
        del worker.tasks[tick.scheduled.task.id]
        tick.scheduled.woken = True
        self.main.add(tick.scheduled)
        return [f"task {tick.scheduled.task.id}: {reason}"]
