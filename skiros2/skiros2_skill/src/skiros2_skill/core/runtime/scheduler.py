"""Schedules the tasks of a manager: commands, wakes, and the threads that tick."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Collection

from skiros2_common.core.errors import Refused, RobotStopped, UnknownName
from skiros2_common.core.operations import Change
from skiros2_common.core.signals import SignalSource
from skiros2_common.core.world_model_port import WorldModelPort, changed_ids
from skiros2_runs.core.task_run import KEEP_ALIVE
from skiros2_skill.core.engine.breakpoints import Breakpoints
from skiros2_skill.core.runtime.task import MAX_ID, Task
from skiros2_skill.core.runtime.worker import MAX_WAKES, ScheduledTask, TickSettings, Watchdog

#: Each level of a tree takes about six stack frames; Python's default limit of 1000 allows 150 levels.
RECURSION_LIMIT = 100_000


class Scheduler:
    """Ticks tasks at a fixed rate, and woken tasks at once.

    One thread ticks all tasks in turn. A task with a slow hook keeps that thread, and the other tasks move to a new one
    (see `Watchdog`).

    :param rate: ticks per second.
    :param on_tick: called after each period, in a ticking thread.
    :param on_progress: called with a task, in a ticking thread, after each tick in which something changed, at least
        every `keep_alive` seconds, and when the task has ended.
    :param keep_alive: s.
    :param preempt_timeout: s that the skills of a preempted task have to end.
    :param hook_timeout: s after which a hook of a preempted task that has not returned is abandoned.
    :param signals: for hold-conditions on signals; None: no signal is published.
    :param first_id: the id of the first task.
    :param collects_evidence: whether a new task collects evidence; must not block.
    """

    def __init__(
        self,
        rate: float = 25.0,
        on_tick: Callable[[], None] = lambda: None,
        on_progress: Callable[[Task], None] = lambda task: None,
        keep_alive: float = KEEP_ALIVE,
        preempt_timeout: float = 10.0,
        hook_timeout: float = 2.0,
        signals: SignalSource | None = None,
        first_id: int = 0,
        collects_evidence: Callable[[], bool] = lambda: False,
    ) -> None:
        sys.setrecursionlimit(max(sys.getrecursionlimit(), RECURSION_LIMIT))
        self._scheduled: dict[int, ScheduledTask] = {}
        self._next_id = first_id % (MAX_ID + 1)
        self._lock = threading.Condition()
        self._stopped = False
        self._signals = signals
        self._collects_evidence = collects_evidence
        self.breakpoints = Breakpoints()
        #: Returns why the robot is stopped; "" while it is not. Set by a `SafetyGuard`; must not block.
        self.stop_reason: Callable[[], str] = lambda: ""
        settings = TickSettings(1.0 / rate, keep_alive, on_tick, on_progress)
        self._watchdog = Watchdog(
            settings, self._lock, self._remove, preempt_timeout, min(hook_timeout, preempt_timeout)
        )

    # -- tasks, from any thread --------------------------------------------------------------------------------

    def new_task(self, wmi: WorldModelPort, author: str, goal: str = "") -> Task:
        """Creates a task with a unique id. It is not ticked before `start`.

        :param goal: of which it is a step; "": none.
        :raises Refused: the manager is shutting down.
        """
        with self._lock:
            if self._stopped:
                raise Refused("the manager is shutting down")
            while self._next_id in self._scheduled:
                self._next_id = (self._next_id + 1) % (MAX_ID + 1)
            task = Task(self._next_id, wmi, author, self.breakpoints, self._signals, goal)
            task.waker = lambda: self._wake(task)
            task.evidence.is_on = self._collects_evidence()
            task.pause()
            self._scheduled[task.id] = ScheduledTask(task)
            self._watchdog.main.add(self._scheduled[task.id])
            self._next_id = (self._next_id + 1) % (MAX_ID + 1)
            return task

    def discard(self, task: Task) -> None:
        """Removes a task that was never started."""
        with self._lock:
            scheduled = self._scheduled.pop(task.id, None)
            if scheduled is not None:
                self._watchdog.remove(scheduled)

    def start(self, task_id: int, ticks: int = 0) -> None:
        """Starts a new task or continues a paused one.

        :param ticks: pauses after this many ticks; 0: does not.

        :raises UnknownName: there is no such task.
        :raises Refused: it is running or was preempted.
        :raises RobotStopped: the robot is stopped.
        """
        with self._lock:
            scheduled = self._get(task_id)
            if scheduled.task.preempted_at is not None:
                raise Refused(f"task {task_id} was preempted")
            if not scheduled.task.paused:
                raise Refused(f"task {task_id} runs already")
            stop = self.stop_reason()
            if stop and not scheduled.task.allowed_when_stopped:
                raise RobotStopped(stop)
            scheduled.started = True
            scheduled.task.resume(ticks)
            self._request_tick(scheduled)
        time.sleep(0)  # the ticking thread gets the interpreter lock before the caller logs and answers

    def preempt(self, task_id: int, by: str = "") -> None:
        """Preempts a task.

        :param by: the client that asks for it; "" if unknown.
        :raises UnknownName: there is no such task.
        """
        with self._lock:
            scheduled = self._get(task_id)
            if not scheduled.task.preempt(by=by):
                raise self._unknown(task_id)
            self._request_stop(scheduled)

    def pause(self, task_id: int) -> None:
        """Pauses a task.

        :raises UnknownName: there is no such task.
        """
        with self._lock:
            self._get(task_id).task.pause()

    def wait_until_idle(self, task_ids: Collection[int], timeout: float) -> bool:
        """Waits until tasks are paused or have ended and none of their ticks is in progress.

        :param timeout: s.
        :returns: False after a timeout.
        """
        with self._lock:
            tasks = [s for number in task_ids if (s := self._scheduled.get(number)) is not None]
            return self._lock.wait_for(lambda: all(map(self._is_idle, tasks)), timeout)

    def preempt_all(self, shuts_down: bool = False, by: str = "") -> None:
        """Preempts all tasks; see `Task.preempt`."""
        with self._lock:
            for scheduled in self._scheduled.values():
                scheduled.task.preempt(shuts_down=shuts_down, by=by)
                self._request_stop(scheduled)

    def pause_all(self) -> None:
        """Pauses all tasks."""
        with self._lock:
            for scheduled in self._scheduled.values():
                scheduled.task.pause()

    def pause_running(self, reason: str) -> list[int]:
        """Pauses the running tasks, except those that are allowed when stopped. Returns their ids. Those that are
        ending end without their `on_preempt`.

        :param reason: see `Task.pause`.
        """
        with self._lock:
            running = [s.task for s in self._scheduled.values() if s.task.wants_tick]
            running = [task for task in running if not task.allowed_when_stopped]
            tasks = [task for task in running if task.preempted_at is None]
            for task in running:
                if task.preempted_at is not None:
                    task.preempt(stop=reason)
            for task in tasks:
                task.pause(reason)
            return [task.id for task in tasks]

    def fail_running(self, stop: str) -> list[int]:
        """Fails the tasks that have started, also paused ones, except those that are allowed when stopped.

        :param stop: see `Task.preempt`.
        :returns: their ids.
        """
        with self._lock:
            started = [s for s in self._scheduled.values() if s.started and not s.task.allowed_when_stopped]
            failed = [s for s in started if s.task.preempt(stop=stop)]
            for scheduled in failed:
                self._request_stop(scheduled)
            return [scheduled.task.id for scheduled in failed]

    def set_pause_reason(self, task_ids: Collection[int], reason: str) -> None:
        """Changes the reason of those tasks that are still paused."""
        with self._lock:
            for scheduled in map(self._scheduled.get, task_ids):
                if scheduled is not None and scheduled.task.paused and not scheduled.task.ended.is_set():
                    scheduled.task.pause(reason)

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

    def paused(self) -> list[int]:
        """The ids of the tasks that have started and are paused."""
        with self._lock:
            started = [s.task for s in self._scheduled.values() if s.started and not s.task.ended.is_set()]
            return [task.id for task in started if task.paused and task.preempted_at is None]

    def stop(self, timeout: float = 2.0) -> None:
        """Preempts all tasks, ticks until they have ended, and ends the threads. No `on_preempt` runs.

        :param timeout: s that the tasks have to end, if that is less than `preempt_timeout`; hooks that have not
            returned are then abandoned.
        """
        with self._lock:
            self._stopped = True
            self._watchdog.limit_timeouts(timeout)
            self.preempt_all(shuts_down=True)
        self._watchdog.stop(2 * timeout)

    # -- wakes, from any thread --------------------------------------------------------------------------------

    def on_change(self, change: Change) -> None:
        """Handles a change of the world model: wakes the tasks that it affects, and pauses tasks at breakpoints."""
        reached = self.breakpoints.at_change(change) if self.breakpoints else ""
        with self._lock:
            # A task that makes the change in a tick notices it itself.
            own = self._watchdog.ticked_by_caller()
            running = [s.task for s in self._scheduled.values() if s is not own and s.task.wants_tick]
        changed = changed_ids(change)
        for task in running:
            if reached:
                task.pause(reached)
            if not task.is_current and task.is_affected_by(changed):
                self._wake(task)

    def _wake(self, task: Task) -> None:
        """Requests a tick at once, unless the task has had too many in this period."""
        with self._lock:
            scheduled = self._scheduled.get(task.id)
            if scheduled is not None and scheduled.task is task and scheduled.wakes < MAX_WAKES:
                scheduled.wakes += 1
                self._request_tick(scheduled)

    # -- while the lock is held ----------------------------------------------------------------------------------------

    def _get(self, task_id: int) -> ScheduledTask:
        scheduled = self._scheduled.get(task_id)
        if scheduled is None or scheduled.task.ended.is_set():
            raise self._unknown(task_id)
        return scheduled

    def _unknown(self, task_id: int) -> UnknownName:
        running = [s.task.id for s in self._scheduled.values() if not s.task.ended.is_set() and s.task.id != task_id]
        return UnknownName(f"no task {task_id} is here; there are: {', '.join(map(str, running)) or 'none'}")

    def _is_idle(self, scheduled: ScheduledTask) -> bool:
        task = scheduled.task
        return (task.paused or task.ended.is_set()) and not self._watchdog.is_ticked(scheduled)

    def _request_tick(self, scheduled: ScheduledTask) -> None:
        scheduled.woken = True
        self._lock.notify_all()

    def _request_stop(self, scheduled: ScheduledTask) -> None:
        """Requests the tick that stops a task: before those of other tasks."""
        self._watchdog.put_first(scheduled)
        self._request_tick(scheduled)

    def _remove(self, scheduled: ScheduledTask) -> None:
        self._scheduled.pop(scheduled.task.id, None)
