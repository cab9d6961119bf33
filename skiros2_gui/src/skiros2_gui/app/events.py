"""The events of the window, from the system and from the user, and their queue between threads."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from skiros2_live.core.patch import Connection, GoalProgress, ManagerConnection, SafetyChanged, TaskProgress
from skiros2_runs.core.task_run import TaskRun


@dataclass(frozen=True)
class WorldChanged:
    """The scene has changed.

    :param changes: in order (`skiros2_common.core.operations.Change`).
    :param is_reset: the scene has to be read again: another one was loaded, or the world model has restarted.
    :param ontology: the ontologies may have changed.
    """

    changes: tuple[Any, ...] = ()
    is_reset: bool = False
    ontology: bool = False


@dataclass(frozen=True)
class TasksChanged:
    """Tasks were added or removed, or their states have changed."""


@dataclass(frozen=True)
class RunRecorded:
    """The progress of a task was recorded.

    :param is_new_shape: whether its tree has changed shape.
    """

    run: TaskRun
    is_new_shape: bool


@dataclass(frozen=True)
class FailureExplained:
    """The reason of the failure of a task has been asked for, or answered."""


@dataclass(frozen=True)
class ManagersChanged:
    """Managers have connected or disconnected. Follows the patches of the document that say so."""


@dataclass(frozen=True)
class ConnectionChanged:
    """A part of the system beside the managers has connected or disconnected, or the stops of a robot have changed.
    Follows the patches of the document that say so.
    """


@dataclass(frozen=True)
class ElementSelected:
    """The user has selected an element in a tab; "" for none."""

    eid: str
    by: object = None


@dataclass(frozen=True)
class TaskStarted:
    """The user has started a task, or asks to show it.

    :param manager: the node name of its manager.
    :param to_front: whether to switch to the tab that shows it.
    """

    manager: str
    task: int
    to_front: bool = False


@dataclass(frozen=True)
class StopTarget:
    """A task or goal that is being stopped.

    :param name: for people.
    :param has_ended: returns whether it has ended.
    """

    name: str
    has_ended: Callable[[], bool]


@dataclass(frozen=True, eq=False)
class StopRequested:
    """The user stops everything: all tasks of all robots, and the goal being planned or achieved.

    :param targets: to which each handler adds what it stops.
    """

    targets: list[StopTarget] = field(default_factory=list)


@dataclass(frozen=True)
class ProblemReported:
    """A component outside the jobs reports an error.

    :param activity: what it was doing, such as "moving skiros:Part-1".
    :param text: the error message.
    """

    activity: str
    text: str


@dataclass(frozen=True)
class NodeShutdown:
    """ROS has shut down the node of this process: on request, or because another node took its name.

    :param reason: as given by ROS.
    """

    reason: str


@dataclass(frozen=True, eq=False)
class GoalFeedback:
    """The task manager has sent feedback for a goal of this window.

    :param feedback: an `AchieveFeedback`.
    """

    goal: str
    feedback: Any


Event = (
    WorldChanged
    | Connection
    | ManagerConnection
    | SafetyChanged
    | GoalProgress
    | TaskProgress
    | TasksChanged
    | RunRecorded
    | FailureExplained
    | ManagersChanged
    | ConnectionChanged
    | ElementSelected
    | TaskStarted
    | StopRequested
    | GoalFeedback
    | ProblemReported
    | NodeShutdown
)


#: The patches that are followed by an event without content.
_PATCHES = (Connection, ManagerConnection, SafetyChanged)

#: States of one task in a batch; of more, the oldest are discarded.
MAX_STATES = 20

#: Changes of the scene in a batch; more are replaced with one event that resets the scene.
MAX_CHANGES = 5000


class EventQueue:
    """Collects events of any thread in batches and compresses them.

    A batch has at most one `WorldChanged` and one event of each kind without content; the states of each task keep
    their order. Patches of connections and robots precede `ConnectionChanged` and `ManagersChanged`, which it adds.

    :param wake: called in the thread that puts the first event after a batch; schedules a call of `take`.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._changes: list[WorldChanged] = []
        self._count = 0
        self._tasks: dict[tuple[str, int], deque[TaskProgress]] = {}
        self._plain_events: dict[Event, None] = {}
        self._is_empty = True

    def put(self, event: Event) -> None:
        """Adds an event. Any thread; does not block."""
        with self._lock:
            if isinstance(event, WorldChanged):
                self._changes.append(event)
                self._count += len(event.changes)
                if self._count > MAX_CHANGES:
                    ontology = any(e.ontology for e in self._changes)
                    self._changes, self._count = [WorldChanged((), True, ontology)], 0
            elif isinstance(event, TaskProgress):
                if not event.nodes:
                    return
                key = (event.manager, event.task)
                self._tasks.setdefault(key, deque(maxlen=MAX_STATES)).append(event)
            elif isinstance(event, _PATCHES):
                self._plain_events.pop(event, None)  # the last one counts
                self._plain_events[event] = None
                follows = ManagersChanged() if isinstance(event, ManagerConnection) else ConnectionChanged()
                self._plain_events[follows] = None
            else:
                self._plain_events[event] = None
            was_empty, self._is_empty = self._is_empty, False
        if was_empty:
            self._wake()

    def take(self) -> list[Event]:
        """Returns and clears the batch: connections, managers, the scene, tasks. In the window's thread."""
        with self._lock:
            changes, self._changes, self._count = self._changes, [], 0
            tasks, self._tasks = self._tasks, {}
            plain_events, self._plain_events = self._plain_events, {}
            self._is_empty = True
        batch: list[Event] = sorted(plain_events, key=_rank)
        if changes:
            batch.append(_joined(changes))
        batch += [event for states in tasks.values() for event in states]
        return batch


def _joined(events: list[WorldChanged]) -> WorldChanged:
    if len(events) == 1:
        return events[0]
    return WorldChanged(
        tuple(change for event in events for change in event.changes),
        any(event.is_reset for event in events),
        any(event.ontology for event in events),
    )


def _rank(event: Event) -> int:
    order = (ConnectionChanged, ManagersChanged)
    if isinstance(event, _PATCHES):
        return -1
    return order.index(type(event)) if type(event) in order else len(order)
