"""Applies the stops of a robot to its tasks."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum

from skiros2_skill.core.runtime.safety import Safety, SafetyState, SourceRules, Stop
from skiros2_skill.core.runtime.scheduler import Scheduler

log = logging.getLogger(__name__)


class Policy(StrEnum):
    """The effect of a stop on running tasks."""

    PAUSE = "pause"
    FAIL = "fail"


#: The default policies. A protective stop is cleared without a loss of the robot's state, so its tasks can be resumed.
DEFAULT_POLICIES: Mapping[Safety, Policy] = {
    Safety.PROTECTIVE_STOP: Policy.PAUSE,
    Safety.FAULT: Policy.FAIL,
    Safety.EMERGENCY_STOP: Policy.FAIL,
}


class SafetyGuard:
    """Pauses or fails running tasks when a stop begins, and blocks starts while one is active.

    Tasks of skills that are allowed when stopped are left alone. Paused tasks stay paused after the stop: they are
    resumed by a command. A thread of its own watches the timeouts, if there are sources.

    :param sources: with different names.
    :param policies: by kind of stop; `DEFAULT_POLICIES` for missing ones.
    :param on_change: called with the stops after each change, in order, in any thread.
    """

    def __init__(
        self,
        sources: Iterable[SourceRules],
        policies: Mapping[Safety, Policy],
        scheduler: Scheduler,
        on_change: Callable[[tuple[Stop, ...]], None] = lambda stops: None,
    ) -> None:
        rules = list(sources)
        self._policies = {**DEFAULT_POLICIES, **policies}
        self._scheduler = scheduler
        self._on_change = on_change
        self._changed = threading.Condition()
        self._ended = False
        self._paused: set[int] = set()  # tasks that stops have paused
        self._state = SafetyState(rules, time.monotonic())
        scheduler.stop_reason = lambda: self._state.reason
        self._apply(())
        self._thread: threading.Thread | None = None
        if rules:
            self._thread = threading.Thread(target=self._run, name="safety", daemon=True)
            self._thread.start()

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The active stops, the most severe first. Any thread; does not block."""
        return self._state.stops

    def report(self, source: str, reason: str) -> None:
        """Handles a report of a source. Any thread.

        :param reason: why the robot is stopped; "" if the source reports no stop.
        """
        with self._changed:
            before, deadline = self._state.stops, self._state.deadline()
            if self._state.report(source, reason, time.monotonic()):
                self._apply(before)
            if self._state.deadline() < deadline:
                self._changed.notify_all()

    def close(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        with self._changed:
            while not self._ended:
                before = self._state.stops
                if self._state.update(time.monotonic()):
                    self._apply(before)
                deadline = self._state.deadline()
                self._changed.wait(None if math.isinf(deadline) else max(0.0, deadline - time.monotonic()))

    def _apply(self, before: tuple[Stop, ...]) -> None:
        """Handles a change of the stops, while the lock is held: changes are applied and published in order."""
        stops = self._state.stops
        sources = {stop.source for stop in before}
        for stop in reversed(stops):  # the most severe last: its reason stays
            if stop.source not in sources:
                self._begin(stop)
        for stop in before:
            if stop.source not in {one.source for one in stops}:
                log.info("%s is over after %.1f s", stop, time.time() - stop.since)
        if not stops and self._paused:
            text = f"paused: {before[0]}; it is over, resume or stop the task" if before else "paused"
            self._scheduler.set_pause_reason(self._paused, text)
            self._paused = set()
        self._on_change(stops)

    def _begin(self, stop: Stop) -> None:
        if self._policies[stop.kind] is Policy.FAIL:
            ids = self._scheduler.fail_running(str(stop))
            done = "failed"
        else:
            ids = self._scheduler.pause_running(f"paused: {stop}")
            self._paused |= {*ids}
            done = "paused"
        tasks = f"tasks {', '.join(map(str, ids))} are {done}" if ids else "no task was running"
        log.warning("%s; %s", stop, tasks)
