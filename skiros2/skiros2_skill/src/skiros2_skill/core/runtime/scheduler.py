"""Runs the tasks of a manager: commands, wakes, and the threads that tick."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Collection
from typing import Any

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_skill.core.engine.breakpoints import Breakpoints
from skiros2_skill.core.engine.checks import concerns
from skiros2_skill.core.runtime.task import MAX_ID, Task
from skiros2_skill.core.runtime.watchdog import Watchdog
from skiros2_skill.core.runtime.worker import WAKES, Pace, Scheduled

#: Each level of a tree costs about six frames; Python's own limit of 1000 would end trees of 150 levels.
RECURSION_LIMIT = 100_000


class Ticker:
    """Ticks tasks at a fixed rate and, in between, when they are woken.

    One thread ticks all tasks, one after the other. A task with a hook that does not return keeps that thread, and the
    others get a new one (see `Watchdog`).

    :param rate: ticks per second.
    :param on_tick: called after each round, in a ticking thread.
    :param on_progress: called with a task, in a ticking thread, after each tick in which something changed, at least
        every `keep_alive` seconds, and when the task has ended.
    :param keep_alive: s.
    :param preempt_timeout: s that skills have to end once their task is preempted.
    :param hook_timeout: s after which a hook of a preempted task that does not return is left behind.
    """

    def __init__(
        self,
        rate: float = 25.0,
        on_tick: Callable[[], None] = lambda: None,
        on_progress: Callable[[Task], None] = lambda task: None,
        keep_alive: float = 1.0,
        preempt_timeout: float = 10.0,
        hook_timeout: float = 2.0,
    ) -> None:
        sys.setrecursionlimit(max(sys.getrecursionlimit(), RECURSION_LIMIT))
        self._scheduled: dict[int, Scheduled] = {}
        self._next_id = 0
        self._lock = threading.Condition()
        self._stopped = False
        self.breakpoints = Breakpoints()
        pace = Pace(1.0 / rate, keep_alive, on_tick, on_progress)
        self._watchdog = Watchdog(pace, self._lock, self._forget, preempt_timeout, min(hook_timeout, preempt_timeout))

    # -- tasks, from any thread --------------------------------------------------------------------------------

    def new_task(self, wmi: Any, author: str) -> Task:
        """A task with an id that no other task has. It is not ticked before `start`."""
        with self._lock:
            if self._stopped:
                raise Refused("the manager is shutting down")
            while self._next_id in self._scheduled:
                self._next_id = (self._next_id + 1) % (MAX_ID + 1)
            task = Task(self._next_id, wmi, author, self.breakpoints)
            task.waker = lambda: self._wake(task)
            task.pause()
            self._scheduled[task.id] = Scheduled(task)
            self._watchdog.first.add(self._scheduled[task.id])
            self._next_id = (self._next_id + 1) % (MAX_ID + 1)
            return task

    def discard(self, task: Task) -> None:
        """Forgets a task that was never started."""
        with self._lock:
            scheduled = self._scheduled.pop(task.id, None)
            if scheduled is not None:
                self._watchdog.remove(scheduled)

    def start(self, task_id: int, ticks: int = 0) -> None:
        """Ticks a new or paused task; given a number, pauses it after that many ticks.

        :raises UnknownName: there is no such task.
        :raises Refused: it runs already, or was preempted.
        """
        with self._lock:
            scheduled = self._get(task_id)
            if scheduled.task.preempted_at is not None:
                raise Refused(f"task {task_id} was preempted")
            if not scheduled.task.paused:
                raise Refused(f"task {task_id} runs already")
            scheduled.task.resume(ticks)
            self._call(scheduled)

    def preempt(self, task_id: int) -> None:
        """Ends a task at once.

        :raises UnknownName: there is no such task.
        """
        with self._lock:
            scheduled = self._get(task_id)
            if not scheduled.task.preempt():
                raise self._unknown(task_id)
            self._call(scheduled)

    def pause(self, task_id: int) -> None:
        """Stops ticking a task; it keeps its state.

        :raises UnknownName: there is no such task.
        """
        with self._lock:
            self._get(task_id).task.pause()

    def wait_for_rest(self, task_ids: Collection[int], timeout: float) -> bool:
        """Waits until some tasks are paused or have ended, and no tick of theirs is under way.

        :param timeout: s; a hook that takes longer is not waited for.
        :returns: whether they are.
        """
        with self._lock:
            tasks = [s for number in task_ids if (s := self._scheduled.get(number)) is not None]
            return self._lock.wait_for(lambda: all(map(self._rests, tasks)), timeout)

    def preempt_all(self) -> None:
        """Ends all tasks at once."""
        with self._lock:
            for scheduled in self._scheduled.values():
                scheduled.task.preempt()
                self._call(scheduled)

    def pause_all(self) -> None:
        """Stops ticking all tasks; they keep their states."""
        with self._lock:
            for scheduled in self._scheduled.values():
                scheduled.task.pause()

    def get(self, task_id: int) -> Task:
        """The task with that id.

        :raises UnknownName: there is none, or it has ended.
        """
        with self._lock:
            return self._get(task_id).task

    def tasks(self) -> list[Task]:
        """The tasks that have not ended."""
        with self._lock:
            return [s.task for s in self._scheduled.values() if not s.task.ended.is_set()]

    def stop(self, timeout: float = 2.0) -> None:
        """Preempts all tasks, ticks until they have ended, and ends the threads.

        :param timeout: s that the tasks have to end, where that is less than the time they have anyway; what does not
            return is left behind then.
        """
        with self._lock:
            self._stopped = True
            self._watchdog.hurry(timeout)
            self.preempt_all()
        self._watchdog.stop(2 * timeout)

    # -- wakes, from any thread --------------------------------------------------------------------------------

    def on_change(self, change: Any) -> None:
        """Takes a change of the world model: ticks the tasks that it concerns, and pauses them at breakpoints."""
        reached = self.breakpoints.at_change(change) if self.breakpoints else ""
        with self._lock:
            # A task sees by itself what it changes in a tick.
            running = [
                s.task for s in self._scheduled.values() if s.task.wants_tick and not self._watchdog.ticks_here(s)
            ]
        for task in running:
            if reached:
                task.hold(reached)
            if not task.has_seen_world and concerns(task.root, change):
                self._wake(task)

    def _wake(self, task: Task) -> None:
        """A tick at once, unless the task has had too many since the last slot."""
        with self._lock:
            scheduled = self._scheduled.get(task.id)
            if scheduled is not None and scheduled.task is task and scheduled.wakes < WAKES:
                scheduled.wakes += 1
                self._call(scheduled)

    # -- under the lock ----------------------------------------------------------------------------------------

    def _get(self, task_id: int) -> Scheduled:
        scheduled = self._scheduled.get(task_id)
        if scheduled is None or scheduled.task.ended.is_set():
            raise self._unknown(task_id)
        return scheduled

    def _unknown(self, task_id: int) -> UnknownName:
        running = [s.task.id for s in self._scheduled.values() if not s.task.ended.is_set() and s.task.id != task_id]
        return UnknownName(f"no task {task_id} is here; there are: {', '.join(map(str, running)) or 'none'}")

    def _rests(self, scheduled: Scheduled) -> bool:
        task = scheduled.task
        return (task.paused or task.ended.is_set()) and not self._watchdog.is_ticked(scheduled)

    def _call(self, scheduled: Scheduled) -> None:
        scheduled.woken = True
        self._lock.notify_all()

    def _forget(self, scheduled: Scheduled) -> None:
        self._scheduled.pop(scheduled.task.id, None)
