"""Watches the ticking threads for slow hooks, and for hooks that do not return."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from skiros2_skill.core.runtime.worker import ScheduledTask, Tick, TickSettings, Worker

log = logging.getLogger(__name__)

_SLOW_TICK = 0.1  # s after which the other tasks move to a new thread
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

    def is_ticking(self, scheduled: ScheduledTask | None = None) -> bool:
        """Whether the calling thread is ticking the task, or any task."""
        thread = threading.current_thread()
        ticks = [worker.current for worker in self._workers if worker.thread is thread]
        return any(tick is not None and scheduled in (None, tick.scheduled) for tick in ticks)

    def is_ticked(self, scheduled: ScheduledTask) -> bool:
        """Whether a tick of the task is in progress."""
        ticks = [w.current for w in self._workers if w.tasks.get(scheduled.task.id) is scheduled]
        return any(tick is not None and tick.scheduled is scheduled for tick in ticks)

    def remove(self, scheduled: ScheduledTask) -> None:
        """Stops ticking a task."""
        for worker in self._workers:
            if worker.tasks.get(scheduled.task.id) is scheduled:
                del worker.tasks[scheduled.task.id]

    # -- the end -----------------------------------------------------------------------------------------------

    def stop(self, seconds: float) -> None:
        """Waits until all tasks have ended and ends the threads.

        :param seconds: maximum time to wait.
        """
        with self._lock:
            if not self.is_ticking():
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
            if worker is self.main and age > max(_SLOW_TICK, 2 * self._settings.period):
                self._move_other_tasks(worker, tick)
                warnings.append(
                    f"task {tick.scheduled.task.id}: {hook or 'a tick'} has run for {age:.1f} s; "
                    "other tasks moved to a new thread"
                )
        for scheduled in list(worker.tasks.values()):
            preempted_at = scheduled.task.preempted_at
            if preempted_at is None:
                continue
            if tick is not None and tick.scheduled is scheduled:
                if tick.hook and now - max(preempted_at, tick.hook_since) >= self._hook_timeout:
                    warnings += self._abandon(worker, tick, now)
            elif now - preempted_at >= self._timeout:
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
