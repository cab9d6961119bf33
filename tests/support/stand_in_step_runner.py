"""Simulates the execution of steps in a local world model, by the conditions of the skills."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from skiros2_task.core.goal_execution import Began, Ended
from skiros2_task.core.plan import Step
from support.plan_checks import do
from support.planning_world import PlanningWorld


class StandInStepRunner:
    """Applies the effects of each step after a delay.

    :param seconds: the duration of a step.
    :param on_change: called after the world has been changed.
    :ivar after_effects: called after the effects of a step, before its end.
    """

    def __init__(self, world: PlanningWorld, seconds: float = 0.02) -> None:
        self._world = world
        self.seconds = seconds
        self.stop_seconds = 0.0  # from a stop to the end of the step
        self._stopping: set[int] = set()
        self._change = threading.Condition()
        self.on_change: Callable[[], None] = lambda: None
        self.after_effects: Callable[[], None] = lambda: None
        self.started: list[tuple[float, Step]] = []  # with the start time (s, monotonic)
        self.goals: list[str] = []  # of the started steps
        self.max_parallel = 0  # the largest number of steps that ran at the same time
        self._running: dict[int, tuple[Step, Ended]] = {}
        self._runs: dict[str, int] = {}  # the key of each run, by its id
        self._results: dict[int, tuple[bool, str]] = {}  # of ended steps that nobody followed

    def start(
        self, step: Step, ended: Ended, run: str = "", began: Began | None = None, goal: str = ""
    ) -> Callable[[], None]:
        with self._change:
            self.goals.append(goal)
            self.started.append((time.monotonic(), step))
            key = len(self.started)
            if began is not None:
                began(key)
            self._runs[run] = key
            self._running[key] = (step, ended)
            self.max_parallel = max(self.max_parallel, len(self._running))
            self._change.notify_all()
        timer = threading.Timer(self.seconds, self._finish, (key,))
        timer.daemon = True
        timer.start()
        return lambda: self._stop(key)

    def attach(
        self, step: Step, run: str, known: Callable[[bool], None], ended: Ended, began: Began | None = None
    ) -> Callable[[], None]:
        with self._change:
            key = self._runs.get(run, 0)
            result = self._results.pop(key, None)
            if key in self._running:
                self._running[key] = (step, ended)
            is_known = key in self._running or result is not None
        known(is_known)
        if result is not None:
            ended(*result, ())
        return lambda: self._stop(key)

    def kill_client(self) -> None:
        """The process that has started the steps is killed: nobody follows them any more."""

        def keep(key: int) -> Ended:
            return lambda succeeded, message, _: self._results.update({key: (succeeded, message)})

        with self._change:
            self._running = {key: (step, keep(key)) for key, (step, _) in self._running.items()}

    def restart(self) -> None:
        """The robots are killed as well: they forget their steps."""
        with self._change:
            self._running.clear()
            self._runs.clear()

    def _stop(self, key: int) -> None:
        """Ends a step without effects, after `stop_seconds`."""
        if not self.stop_seconds:
            self._end(key, False, "stopped")
            return
        with self._change:
            self._stopping.add(key)
        timer = threading.Timer(self.stop_seconds, self._end, (key, False, "stopped"))
        timer.daemon = True
        timer.start()

    def wait_for_starts(self, count: int, timeout: float = 30.0) -> None:
        """Waits until `count` steps were started."""
        with self._change:
            assert self._change.wait_for(lambda: len(self.started) >= count, timeout), f"{len(self.started)} steps"

    def wait_for_step(self, condition: Callable[[Step], bool], timeout: float = 30.0) -> float:
        """Waits until a matching step was started. Returns the start time (s, monotonic)."""

        def found() -> float | None:
            return next((time for time, step in self.started if condition(step)), None)

        with self._change:
            started = self._change.wait_for(found, timeout)
            assert started is not None, "no such step"
            return started

    def lose(self, manager: str) -> None:
        """Drops the steps of a robot without a report."""
        with self._change:
            self._running = {k: (step, e) for k, (step, e) in self._running.items() if step.call.manager != manager}

    def _finish(self, key: int) -> None:
        with self._change:
            if key not in self._running or key in self._stopping:
                return
            try:
                do(self._world, self._running[key][0].call)
            except AssertionError as error:
                self._end(key, False, str(error))
                return
        self.after_effects()
        self._end(key, True, "done")
        self.on_change()

    def _end(self, key: int, succeeded: bool, message: str) -> None:
        with self._change:
            running = self._running.pop(key, None)
        if running is not None:
            running[1](succeeded, message, ())
