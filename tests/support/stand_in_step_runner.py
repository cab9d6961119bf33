"""Simulated robots that run plan steps on a world model in process, by the conditions of the skills."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from skiros2_task.core.executor import Ended
from skiros2_task.core.steps import Step
from support.plan_checks import do
from support.planning_world import PlanningWorld


class StandInStepRunner:
    """Each step takes some time; then its effects are in the world model.

    :param seconds: that a step takes.
    :param on_change: called after the world has been changed.
    """

    def __init__(self, world: PlanningWorld, seconds: float = 0.02) -> None:
        self._world = world
        self._seconds = seconds
        self._change = threading.Condition()
        self.on_change: Callable[[], None] = lambda: None
        self.begun: list[tuple[float, Step]] = []  # with the time
        self.at_once = 0  # so many steps ran at the same time at most
        self._running: dict[int, tuple[Step, Ended]] = {}

    def start(self, step: Step, ended: Ended) -> Callable[[], None]:
        with self._change:
            self.begun.append((time.monotonic(), step))
            key = id(step)
            self._running[key] = (step, ended)
            self.at_once = max(self.at_once, len(self._running))
            self._change.notify_all()
        timer = threading.Timer(self._seconds, self._finish, (key,))
        timer.daemon = True
        timer.start()
        return lambda: self._end(key, False, "stopped")

    def wait_for_starts(self, count: int, timeout: float = 30.0) -> None:
        """Waits until a number of steps were started."""
        with self._change:
            assert self._change.wait_for(lambda: len(self.begun) >= count, timeout), f"{len(self.begun)} steps"

    def wait_for_step(self, condition: Callable[[Step], bool], timeout: float = 30.0) -> float:
        """Waits until such a step was started, and returns when (s, monotonic)."""

        def found() -> float | None:
            return next((begun for begun, step in self.begun if condition(step)), None)

        with self._change:
            began = self._change.wait_for(found, timeout)
            assert began is not None, "no such step"
            return began

    def lose(self, manager: str) -> None:
        """The steps of a robot have no effect, without a message."""
        with self._change:
            self._running = {k: (step, e) for k, (step, e) in self._running.items() if step.call.manager != manager}

    def _finish(self, key: int) -> None:
        with self._change:
            if key not in self._running:
                return
            try:
                do(self._world, self._running[key][0].call)
            except AssertionError as error:
                self._end(key, False, str(error))
                return
        self._end(key, True, "done")
        self.on_change()

    def _end(self, key: int, succeeded: bool, message: str) -> None:
        with self._change:
            running = self._running.pop(key, None)
        if running is not None:
            running[1](succeeded, message, ())
