"""The safety state of a robot: the stops that are active. This is not a safety-rated function."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

#: The longest reason of a stop (characters): publishers of diagnostics may write anything.
MAX_REASON = 300


class Safety(StrEnum):
    """The safety states of a robot, the least severe first."""

    RUNNING = "running"
    PROTECTIVE_STOP = "protective_stop"
    FAULT = "fault"
    EMERGENCY_STOP = "emergency_stop"

    @property
    def severity(self) -> int:
        """0 for `RUNNING`; greater for more severe states."""
        return list(Safety).index(self)

    @property
    def words(self) -> str:
        """The name for people."""
        return self.value.replace("_", " ")


@dataclass(frozen=True)
class Stop:
    """An active stop.

    :param kind: any state but `RUNNING`.
    :param source: the name of the source that reports it; only this source clears it.
    :param reason: one line.
    :param since: s since the epoch.
    """

    kind: Safety
    source: str
    reason: str
    since: float

    def __str__(self) -> str:
        return f"{self.kind.words} by {self.source}: {self.reason}"


@dataclass(frozen=True)
class SourceRules:
    """How the reports of one source are understood.

    :param kind: of its stops.
    :param timeout: s without a report after which a required source counts as stopped; None: it is not required.
    :param clear_delay: s without a stop in the reports after which its stop ends: a flapping signal is one stop.
    """

    name: str
    kind: Safety
    timeout: float | None = None
    clear_delay: float = 0.5


@dataclass
class _Input:
    """The reports of one source.

    :param heard_at, clear_since: s, monotonic; -inf before the first report, None while it reports a stop.
    """

    rules: SourceRules
    reason: str = ""
    heard_at: float = -math.inf
    clear_since: float | None = None
    stop: Stop | None = None

    def problem(self, now: float) -> str:
        """Why the source counts as stopped; "" if it does not."""
        timeout = self.rules.timeout
        if timeout is None or now - self.heard_at < timeout:
            return self.reason
        if math.isinf(self.heard_at):
            return "no message yet, and the source is required"
        return f"no message for {timeout:g} s, and the source is required"

    def update(self, now: float) -> None:
        reason = self.problem(now)
        if reason:
            self.clear_since = None
            if self.stop is None:
                self.stop = Stop(self.rules.kind, self.rules.name, reason, time.time())
            elif self.stop.reason != reason:
                self.stop = replace(self.stop, reason=reason)
        elif self.stop is not None:
            if self.clear_since is None:
                self.clear_since = now
            if now - self.clear_since >= self.rules.clear_delay:
                self.stop = self.clear_since = None

    def deadline(self) -> float:
        """When `update` may change the stop without a report (s, monotonic); inf: never."""
        ends = []
        if self.stop is not None and self.clear_since is not None:
            ends.append(self.clear_since + self.rules.clear_delay)
        timeout = self.rules.timeout
        if timeout is not None and not (self.stop is not None and self.clear_since is None):
            ends.append(self.heard_at + timeout)
        return min(ends, default=math.inf)


class SafetyState:
    """The state machine of one robot: the worst of the stops of all sources. One thread at a time; any reads `stops`.

    :param sources: with different names.
    :param now: s, monotonic. Required sources are stopped until their first report.
    """

    def __init__(self, sources: Iterable[SourceRules], now: float) -> None:
        self._inputs = {rules.name: _Input(rules) for rules in sources}
        #: The active stops, the most severe first, then the oldest first.
        self.stops: tuple[Stop, ...] = ()
        self.update(now)

    @property
    def state(self) -> Safety:
        """The most severe state; an emergency stop wins."""
        stops = self.stops
        return stops[0].kind if stops else Safety.RUNNING

    @property
    def reason(self) -> str:
        """The most severe stop for people; "" while there is none."""
        stops = self.stops
        return str(stops[0]) if stops else ""

    def report(self, source: str, reason: str, now: float) -> bool:
        """Handles a report of a source. Returns whether `stops` has changed.

        :param reason: why the robot is stopped; "" if the source reports no stop.
        :param now: s, monotonic.
        """
        found = self._inputs[source]
        found.reason = reason if len(reason) <= MAX_REASON else f"{reason[:MAX_REASON]}…"
        found.heard_at = now
        if not reason and found.stop is None:
            return False  # the usual case, at the rate of a driver's state
        return self.update(now)

    def update(self, now: float) -> bool:
        """Handles the passing of time. Returns whether `stops` has changed.

        :param now: s, monotonic.
        """
        for one in self._inputs.values():
            one.update(now)
        active = [one.stop for one in self._inputs.values() if one.stop is not None]
        stops = tuple(sorted(active, key=lambda stop: (-stop.kind.severity, stop.since)))
        changed = stops != self.stops
        self.stops = stops
        return changed

    def deadline(self) -> float:
        """When `update` is to be called next (s, monotonic); inf: after the next report."""
        return min((one.deadline() for one in self._inputs.values()), default=math.inf)
