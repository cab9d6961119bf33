"""The skill managers that are there, and what is heard of their tasks."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_gui.core.events import Progressed
from skiros2_gui.ros.progress import QuickTreeProgress
from skiros2_msgs import msg as msgs
from skiros2_skill.command_line.connection import Manager
from skiros2_skill.ros.discovery_interface import DiscoveryInterface
from skiros2_skill.ros.skill_layer_interface import NAMESPACE

log = logging.getLogger(__name__)

#: So many states wait to be read at most; older ones are dropped.
_QUEUE = 200


class RosManager(Manager):
    """A manager, as the port has it."""

    def command(self, action: str, task_id: int, skills: Sequence[Any] = ()) -> int:
        messages = [msgs.ResourceDescription(s.type, s.label, [msgs.Param(p) for p in s.params]) for s in skills]
        return super().command(action, task_id, messages)


class ManagersLink(DiscoveryInterface):
    """Follows the managers. One that was there is known as gone until it comes again.

    :param author: stands in the managers' logs as who asked.
    :param told: called with each state of a task, in threads of ROS.
    :param changed: called, likewise, when a manager has come or gone.
    """

    def __init__(self, author: str, told: Callable[[Progressed], None], changed: Callable[[], None]) -> None:
        self._author = author
        self._told = told
        self._changed = changed
        self._up: dict[str, RosManager] = {}
        self._since: dict[str, float] = {}
        self._subscribers: dict[str, Any] = {}
        self._connected: set[str] = set()  # those that have been heard
        self.init_discovery(NAMESPACE, self._on_up, self._on_down)

    @property
    def managers(self) -> dict[str, RosManager]:
        """Those that are up, by node name."""
        with self._discovery_lock:
            return dict(sorted(self._up.items()))

    def states(self) -> list[tuple[str, bool, float]]:
        """Of each that is or was there its name, whether it is up, and since when (s since the epoch)."""
        with self._discovery_lock:
            return [(name, name in self._up, since) for name, since in sorted(self._since.items())]

    def check(self) -> None:
        """Notices sooner than by their silence that managers have gone. Called from time to time."""
        with self._discovery_lock:
            for name, subscriber in list(self._subscribers.items()):
                is_connected = subscriber.get_num_connections() > 0
                if name in self._connected and not is_connected:
                    self._drop(name)
                elif is_connected:
                    self._connected.add(name)

    def close(self) -> None:
        """Follows them no more."""
        self.stop_discovery()
        with self._discovery_lock:
            subscribers, self._subscribers = self._subscribers, {}
        for subscriber in subscribers.values():
            subscriber.unregister()

    def _on_up(self, name: str) -> None:
        self._up[name] = manager = RosManager(name, self._author)
        self._since[name] = time.time()
        self._subscribers[name] = rospy.Subscriber(
            f"{name}/monitor", QuickTreeProgress, self._on_progress, name, queue_size=_QUEUE
        )
        threading.Thread(target=self._catch_up, args=(manager,), name="window tasks", daemon=True).start()
        self._changed()

    def _on_down(self, name: str) -> None:
        del self._up[name]
        self._since[name] = time.time()
        self._connected.discard(name)
        self._subscribers.pop(name).unregister()
        self._changed()

    def _on_progress(self, message: Any, name: str) -> None:
        if message.progress:
            self._told(Progressed(name, message.progress, time.time()))

    def _catch_up(self, manager: RosManager) -> None:
        """Tells of the tasks that are there already: one that is paused is told of by nobody else."""
        try:
            tasks = manager.tasks()
        except SkirosError as error:
            log.info("the tasks of %s are not known yet: %s", manager.name, error)
            return
        for nodes in tasks:
            if nodes:
                self._told(Progressed(manager.name, nodes, time.time()))
