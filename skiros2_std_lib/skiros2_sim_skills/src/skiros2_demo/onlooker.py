"""What a node learns of a system by listening: the world, and the trees of one robot."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_common.core.errors import SkirosError
from skiros2_demo.world_state import WorldState
from skiros2_msgs.msg import TreeProgress, WmMonitor


class Onlooker:
    """Listens from its creation on; needs an initialised ROS node. `close` ends it.

    :param robot: the skill manager's node name, with its leading slash.
    """

    def __init__(self, robot: str) -> None:
        self._change = threading.Condition()
        self._world = WorldState()
        self._trees: dict[int, list[Any]] = {}
        self._problem = ""
        self._subscribers = [
            rospy.Subscriber("wm/monitor", WmMonitor, self._take_change),
            rospy.Subscriber(f"{robot}/monitor", TreeProgress, self._take_progress),
        ]

    def close(self) -> None:
        """Listens no more."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def world(self) -> WorldState:
        """The world now.

        :raises SkirosError: a change could not be followed.
        """
        with self._change:
            if self._problem:
                raise SkirosError(self._problem)
            return self._world.copy()

    def follow(self, task_id: int, show: Callable[[list[Any]], None], check: Callable[[], None]) -> list[Any]:
        """Waits for the end of a task and returns the last progress of its nodes.

        :param show: called with the progress of the nodes each time it has changed.
        :param check: called about five times a second; may raise to give up.
        """
        shown = None
        while True:
            check()
            with self._change:
                if self._trees.get(task_id) is shown:
                    self._change.wait(0.2)
                nodes = self._trees.get(task_id)
            if nodes is None or nodes is shown:
                continue
            shown = nodes
            show(nodes)
            if abs(nodes[0].progress_code) == 1:
                return nodes

    def _take_change(self, message: Any) -> None:
        with self._change:
            try:
                self._world.apply(message)
            except SkirosError as error:
                self._problem = str(error)

    def _take_progress(self, message: Any) -> None:
        if message.progress:
            with self._change:
                self._trees[message.progress[0].task_id] = message.progress
                self._change.notify_all()
