"""Follows the skill managers: their tasks, and the stops of their robots."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.forward_clock import now
from skiros2_live.core.patch import ManagerConnection, SafetyChanged, TaskProgress
from skiros2_live.ros.tree_progress import QuickTreeProgress
from skiros2_msgs.msg import SafetyStatus
from skiros2_skill.client.manager import ENDED, ManagerClient
from skiros2_skill.ros.discovery_interface import DiscoveryInterface
from skiros2_skill.ros.skill_layer_interface import NAMESPACE

log = logging.getLogger(__name__)

#: Messages queued for each manager; older ones are dropped.
_QUEUE = 1000
#: The time after which a manager that has not answered is asked for its tasks again (s).
_RETRY_DELAY = 1.0
#: How often the connection to a manager's progress is looked at before that (s).
_CONNECTION_DELAY = 0.02

#: What a manager reports.
ManagerPatch = ManagerConnection | SafetyChanged | TaskProgress


class ManagerConnections(DiscoveryInterface):
    """Discovers managers and subscribes to their progress.

    :param author: named in the managers' logs.
    :param report: called with each patch, in threads of ROS; must not block.
    """

    def __init__(self, author: str, report: Callable[[ManagerPatch], None]) -> None:
        self._author = author
        self._report = report
        self._up: dict[str, ManagerClient] = {}
        self._subscribers: dict[str, Any] = {}
        self._safety_subscribers: dict[str, Any] = {}
        self._connected: set[str] = set()  # managers whose publisher has connected
        self.init_discovery(NAMESPACE, self._on_up, self._on_down)

    @property
    def managers(self) -> dict[str, ManagerClient]:
        """The connected managers, by node name."""
        # Without the lock of discovery: callers may hold locks that its callbacks, which are called under it, need.
        return dict(sorted(self._up.copy().items()))

    def check(self) -> None:
        """Detects closed connections before the discovery times out. To be called periodically."""
        with self._discovery_lock:
            for name, subscriber in list(self._subscribers.items()):
                is_connected = subscriber.get_num_connections() > 0
                if name in self._connected and not is_connected:
                    self._drop(name)
                elif is_connected:
                    self._connected.add(name)

    def close(self) -> None:
        """Disconnects."""
        self.stop_discovery()
        with self._discovery_lock:
            subscribers = [*self._subscribers.values(), *self._safety_subscribers.values()]
            self._subscribers, self._safety_subscribers = {}, {}
        for subscriber in subscribers:
            subscriber.unregister()

    def _on_up(self, name: str) -> None:
        self._up[name] = manager = ManagerClient(name, self._author)
        self._report(ManagerConnection(name, True))
        self._subscribers[name] = progress = rospy.Subscriber(
            f"{name}/monitor", QuickTreeProgress, self._on_progress, name, queue_size=_QUEUE
        )
        self._safety_subscribers[name] = rospy.Subscriber(f"{name}/safety", SafetyStatus, self._on_safety, name)
        threading.Thread(target=self._catch_up, args=(manager, progress), name="known tasks", daemon=True).start()

    def _on_down(self, name: str) -> None:
        self._up.pop(name).close()
        self._connected.discard(name)
        self._subscribers.pop(name).unregister()
        self._safety_subscribers.pop(name).unregister()
        self._report(ManagerConnection(name, False))

    def _on_progress(self, message: Any, name: str) -> None:
        if message.progress:
            self._report(TaskProgress(name, message.progress, now()))

    def _on_safety(self, status: Any, name: str) -> None:
        self._report(SafetyChanged(name, status.state, status.reason, tuple(status.stops), status.since.to_sec()))

    def _catch_up(self, manager: ManagerClient, progress: Any) -> None:
        """Reports the tasks that exist already, as soon as the manager answers: a paused task publishes nothing, and
        others may have ended while the manager was silent.

        :param progress: the subscriber of the manager's progress.
        """
        while self._up.get(manager.name) is manager:
            if not progress.get_num_connections():  # a task could end after the answer and before the connection
                if self._discovery_ended.wait(_CONNECTION_DELAY):
                    return
                continue
            asked = now()
            try:
                tasks, ended = manager.read_tasks(), manager.read_tasks(ENDED)
            except SkirosError as error:
                log.info("%s: reading the tasks failed: %s", manager.name, error)
                if self._discovery_ended.wait(_RETRY_DELAY):
                    return
                continue
            for nodes in filter(None, tasks):
                self._report(TaskProgress(manager.name, nodes, asked))
            for nodes in filter(None, ended):
                self._report(TaskProgress(manager.name, nodes, now(), is_past=True))
            return
