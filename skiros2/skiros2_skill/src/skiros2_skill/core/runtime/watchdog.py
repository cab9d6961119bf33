"""Looks after the ticking threads: hooks that take long, and hooks that do not return."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from skiros2_skill.core.runtime.worker import Pace, Scheduled, Tick, Worker

log = logging.getLogger(__name__)

_PATIENCE = 0.1  # s that a tick may take before the other tasks go on without it
_MOST_POLL = 0.02  # s


class Watchdog:
    """Makes the ticking threads and looks at them a few times in each period, in a thread of its own.

    A tick that takes long keeps its thread, and its task is ticked by that one from then on; the other tasks get a new
    one. So one thread does all the work unless a hook holds it up. A task that was preempted and whose hook does not
    return in time leaves hook, thread and instance behind, and is ended by another thread.

    :param lock: guards the workers and what is scheduled; held for moments only.
    :param ended: called, under the lock, with a task that has ended.
    :param timeout: s that the skills of a task have to end once it is preempted.
    :param hook_timeout: s that each hook of such a task has.
    """

    def __init__(
        self,
        pace: Pace,
        lock: threading.Condition,
        ended: Callable[[Scheduled], None],
        timeout: float,
        hook_timeout: float,
    ) -> None:
        self._pace = pace
        self._lock = lock
        self._ended = ended
        self._timeout = timeout
        self._hook_timeout = hook_timeout
        self._poll = min(pace.period / 4, _MOST_POLL)
        self._stopping = False
        self._sleep = threading.Event()
        #: The worker that new tasks go to.
        self.first = Worker(pace, lock, ended)
        self._workers = [self.first]
        self._thread = threading.Thread(target=self._run, name="ticker watchdog", daemon=True)
        self._thread.start()

    # -- under the lock, from any thread -------------------------------------------------------------------------

    def hurry(self, timeout: float) -> None:
        """Tasks have so long at most to end."""
        self._timeout = min(self._timeout, timeout)
        self._hook_timeout = min(self._hook_timeout, timeout)

    def ticks_here(self, scheduled: Scheduled | None = None) -> bool:
        """Whether the calling thread is ticking the task, or any."""
        here = threading.current_thread()
        ticks = [worker.now for worker in self._workers if worker.thread is here]
        return any(tick is not None and scheduled in (None, tick.scheduled) for tick in ticks)

    def is_ticked(self, scheduled: Scheduled) -> bool:
        """Whether a tick of the task is under way."""
        ticks = [w.now for w in self._workers if w.tasks.get(scheduled.task.id) is scheduled]
        return any(tick is not None and tick.scheduled is scheduled for tick in ticks)

    def remove(self, scheduled: Scheduled) -> None:
        """Forgets a task."""
        for worker in self._workers:
            if worker.tasks.get(scheduled.task.id) is scheduled:
                del worker.tasks[scheduled.task.id]

    # -- the end -----------------------------------------------------------------------------------------------

    def stop(self, seconds: float) -> None:
        """Waits until all tasks have ended, so long at most, and ends the threads."""
        with self._lock:
            if not self.ticks_here():
                self._lock.wait_for(lambda: not any(worker.tasks for worker in self._workers), seconds)
            for worker in self._workers:
                worker.stopping = True
            left = [s.task.id for worker in self._workers for s in worker.tasks.values()]
            threads = [w.thread for w in self._workers if w.now is None and not w.tasks]
            self._stopping = True
            self._lock.notify_all()
        self._sleep.set()
        if left:
            log.error("these tasks have not ended within %.1f s: %s", seconds, ", ".join(map(str, left)))
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
                self._workers = [w for w in self._workers if w is self.first or w.tasks or w.now is not None]
                news = [text for worker in list(self._workers) for text in self._look(worker)]
            for text in news:
                log.warning("%s", text)
            self._sleep.wait(self._poll)

    def _look(self, worker: Worker) -> list[str]:
        """Looks at a worker. Returns what there is to tell."""
        now = time.monotonic()
        news = []
        tick = worker.now
        if tick is not None:
            age = now - tick.since
            place = tick.scheduled.task.place
            if place != tick.hook:
                tick.hook, tick.hook_since = place, now
            if age > self._pace.period / 2 and place:
                tick.places[place] += 1
            if worker is self.first and age > max(_PATIENCE, 2 * self._pace.period):
                self._hand_over(worker, tick)
                news.append(f"task {tick.scheduled.task.id}: {place or 'a tick'} takes long; the others go on")
        for scheduled in list(worker.tasks.values()):
            asked = scheduled.task.preempted_at
            if asked is None:
                continue
            if tick is not None and tick.scheduled is scheduled:
                if tick.hook and now - max(asked, tick.hook_since) >= self._hook_timeout:
                    news += self._leave_behind(worker, tick, now)
            elif now - asked >= self._timeout:
                scheduled.task.give_up(now)
                scheduled.woken = True
                self._lock.notify_all()
        return news

    def _hand_over(self, worker: Worker, tick: Tick) -> None:
        """A worker keeps the task that it is ticking; the others go to a new one."""
        others = [s for s in worker.tasks.values() if s is not tick.scheduled]
        worker.first = False
        self.first = Worker(self._pace, self._lock, self._ended)
        self.first.stopping = worker.stopping
        self._workers.append(self.first)
        for scheduled in others:
            del worker.tasks[scheduled.task.id]
            scheduled.woken = True
            self.first.add(scheduled)

    def _leave_behind(self, worker: Worker, tick: Tick, now: float) -> list[str]:
        """Gives a task whose hook does not return to another worker, if the hook has not returned just now."""
        if worker is self.first:
            self._hand_over(worker, tick)
        left = tick.scheduled.task.leave_behind(now, now - tick.since)
        if not left:
            return []
        del worker.tasks[tick.scheduled.task.id]
        tick.scheduled.woken = True
        self.first.add(tick.scheduled)
        return [f"task {tick.scheduled.task.id}: {left}"]
