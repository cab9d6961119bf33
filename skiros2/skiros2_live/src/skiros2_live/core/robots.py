"""The states of robots, and counters in the manner of the OEE (overall equipment effectiveness, ISO 22400-2)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_live.core.patch import SafetyChanged
from skiros2_runs.core.progress import NodeMessage, has_ended, task_state
from skiros2_runs.core.states import FAILURE, SUCCESS, TaskState

#: The states of a robot without a stop; disconnected: its skill manager does not run.
IDLE, BUSY, PAUSED, DISCONNECTED = "idle", "busy", "paused", "disconnected"
#: The state of a `SafetyStatus` without a stop.
_NO_STOP = "running"


@dataclass(frozen=True)
class Totals:
    """The sums of which a robot's counters are made.

    :param times: how long it has been in each state (s).
    """

    times: Mapping[str, float] = field(default_factory=dict)
    succeeded: int = 0
    failed: int = 0

    def counters(self) -> dict[str, float]:
        """Returns times (s), counts and ratios.

        `availability` is the share of time without stop, `utilisation` that with a running task, and `quality` the
        share of ended tasks that succeeded; lost tasks have failed. `oee` is the product of availability and quality:
        the platform knows no ideal cycle time, so the performance counts as 1.
        """
        total = sum(self.times.values())
        down = sum(seconds for state, seconds in self.times.items() if state not in (IDLE, BUSY, PAUSED))
        ended = self.succeeded + self.failed
        availability = 1.0 - down / total if total else 1.0
        quality = self.succeeded / ended if ended else 1.0
        return {
            "total_s": total,
            "busy_s": self.times.get(BUSY, 0.0),
            "down_s": down,
            "succeeded": self.succeeded,
            "failed": self.failed,
            "availability": availability,
            "utilisation": self.times.get(BUSY, 0.0) / total if total else 0.0,
            "quality": quality,
            "oee": availability * quality,
        }


@dataclass
class RobotTask:
    """A task of a skill manager.

    :param is_paused: whether it waits for a command to go on.
    """

    label: str
    is_paused: bool = False


@dataclass
class Robot:
    """A robot.

    :param name: the node name of its skill manager.
    :param connection_since: when its manager connected or disconnected (s since the epoch).
    :param safety: the last one reported; None: none, or it is not connected.
    :param tasks: those that have not ended.
    :param times: how long it has been in each state, up to `since` (s).
    """

    name: str
    clock: Callable[[], float] = time.time
    is_connected: bool = True
    connection_since: float = 0.0
    safety: SafetyChanged | None = None
    tasks: dict[int, RobotTask] = field(default_factory=dict)
    succeeded: int = 0
    failed: int = 0
    times: dict[str, float] = field(default_factory=dict)
    since: float = 0.0
    state: str = IDLE

    def __post_init__(self) -> None:
        self.since = self.connection_since = self.clock()

    @property
    def stop(self) -> str:
        """The kind of the active stop, such as `protective_stop`; "" if there is none."""
        return self.safety.state if self.safety is not None and self.safety.state != _NO_STOP else ""

    @property
    def reason(self) -> str:
        """The reason of the stop; "" if it is not known."""
        return self.safety.reason if self.safety is not None else ""

    def connect(self, is_connected: bool) -> None:
        """Notes that its manager has connected or disconnected; the known tasks are lost."""
        if is_connected != self.is_connected:
            self.is_connected, self.connection_since = is_connected, self.clock()
        self.safety = None
        self.failed += len(self.tasks)
        self.tasks.clear()

    def follow(self, nodes: Sequence[NodeMessage], *, is_new: bool = False) -> bool:
        """Notes the progress of a task. Returns whether it has just ended.

        :param nodes: the root first.
        :param is_new: whether it is the first message of the task, which may be the last one too.
        """
        root = nodes[0]
        if not has_ended(nodes):
            label = nodes[1].label if len(nodes) > 1 else root.label
            self.tasks.setdefault(root.id, RobotTask(label)).is_paused = task_state(root) is TaskState.PAUSED
        elif self.tasks.pop(root.id, None) is not None or is_new:
            self.succeeded += root.state == SUCCESS
            self.failed += root.state == FAILURE
            return True
        return False

    def update(self) -> bool:
        """Computes the state. Returns whether it has changed."""
        state = self._state()
        if state == self.state:
            return False
        now = self.clock()
        self.times[self.state] = self.times.get(self.state, 0.0) + now - self.since
        self.state, self.since = state, now
        return True

    def _state(self) -> str:
        if not self.is_connected:
            return DISCONNECTED
        if self.stop:
            return self.stop
        if self.tasks and all(task.is_paused for task in self.tasks.values()):
            return PAUSED
        return BUSY if self.tasks else IDLE

    def to_dict(self) -> dict[str, Any]:
        """Returns the robot as JSON data: name, state, reason, since, tasks, counters."""
        tasks = [{"id": number, "label": t.label, "paused": t.is_paused} for number, t in self.tasks.items()]
        return {
            "name": self.name,
            "state": self.state,
            "reason": self.reason,
            "since": self.since,
            "tasks": tasks,
            "counters": self.totals().counters(),
        }

    def totals(self) -> Totals:
        """Returns the sums since the document began, and those from before."""
        times = dict(self.times)
        times[self.state] = times.get(self.state, 0.0) + max(0.0, self.clock() - self.since)
        return Totals(times, self.succeeded, self.failed)

    def add(self, earlier: Totals) -> None:
        """Adds sums from before the document began."""
        for state, seconds in earlier.times.items():
            self.times[state] = self.times.get(state, 0.0) + seconds
        self.succeeded += earlier.succeeded
        self.failed += earlier.failed


def first_stop(robots: Mapping[str, Robot], names: list[str]) -> str:
    """Returns why the named robots stand still, such as `/arm: protective_stop (light curtain)`; "" if none does."""
    for name in names:
        robot = robots.get(name)
        if robot is not None and robot.is_connected and robot.stop:
            return f"{name}: {robot.stop}" + (f" ({robot.reason})" if robot.reason else "")
    return ""
