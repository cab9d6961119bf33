"""Follows the skill managers: their tasks and stops. One callback reports changes, in the thread of the loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_gateway.core.robots import Robot, RobotTask
from skiros2_live.ros.tree_progress import QuickTreeProgress
from skiros2_msgs.msg import SafetyStatus, SkillProgress
from skiros2_runs.core.progress import has_ended, task_state
from skiros2_runs.core.states import TaskState
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface


class Robots(SkillLayerInterface):
    """The robots by the node names of their managers.

    :param changed: called in the thread of the loop with the name of a robot whose state has changed.
    """

    def __init__(self, author: str, loop: asyncio.AbstractEventLoop, changed: Callable[[str], None]) -> None:
        self._loop = loop
        self._on_change = changed
        self._stops: dict[str, rospy.Subscriber] = {}
        self._quick: dict[str, rospy.Subscriber] = {}
        #: Owned by the thread of the loop. A robot whose manager has ended stays, disconnected.
        self.robots: dict[str, Robot] = {}
        #: Called in the thread of the loop with the name of a robot and the nodes of each message of its tasks.
        self.on_tree: Callable[[str, list[Any]], None] = lambda name, nodes: None
        #: Called in the thread of the loop with the name of a robot, and whether it is connected now.
        self.on_connection: Callable[[str, bool], None] = lambda name, is_connected: None
        super().__init__(author)
        self.set_monitor_cb(lambda message: self._call(self._on_tree, message))

    def close(self) -> None:
        """Stops following."""
        self.shutdown()
        for subscriber in [*self._stops.values(), *self._quick.values()]:
            subscriber.unregister()

    # -- in threads of ROS -------------------------------------------------------------------------------------

    def _on_agent(self, name: str) -> None:
        # The first subscriber of a topic decides how it is deserialised; all get the same messages.
        self._quick[name] = rospy.Subscriber(f"{name}/monitor", QuickTreeProgress, queue_size=1000)
        super()._on_agent(name)
        self._call(self._on_connection, name, True)
        self._stops[name] = rospy.Subscriber(
            f"{name}/safety", SafetyStatus, lambda message: self._call(self._on_safety, name, message)
        )

    def _on_agent_gone(self, name: str) -> None:
        super()._on_agent_gone(name)
        self._stops.pop(name).unregister()
        self._quick.pop(name).unregister()
        self._call(self._on_connection, name, False)

    def _call(self, handle: Callable[..., None], *arguments: Any) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(handle, *arguments)

    # -- in the thread of the loop -----------------------------------------------------------------------------

    def _on_connection(self, name: str, is_connected: bool) -> None:
        robot = self.robots.get(name)
        if robot is None:
            robot = self.robots[name] = Robot(name)
            self._on_change(name)
        robot.is_connected = is_connected
        robot.failed += len(robot.tasks)  # they are lost
        robot.tasks.clear()
        self.on_connection(name, is_connected)
        self._update(robot)

    def _on_safety(self, name: str, message: Any) -> None:
        robot = self.robots[name]
        robot.safety, robot.reason = message.state, message.reason
        self._update(robot)

    def _on_tree(self, message: Any) -> None:
        nodes: list[Any] = message.progress
        if not nodes:
            return
        root, robot = nodes[0], self.robots.get(_robot_of(nodes[0]))
        if robot is None:
            return
        self.on_tree(robot.name, nodes)
        if has_ended(nodes):
            if robot.tasks.pop(root.id, None) is not None:
                robot.succeeded += root.state == SkillProgress.SUCCESS
                robot.failed += root.state == SkillProgress.FAILURE
        else:
            task = robot.tasks.get(root.id) or RobotTask(nodes[1].label if len(nodes) > 1 else root.label)
            task.is_paused = task_state(root) is TaskState.PAUSED
            robot.tasks[root.id] = task
        self._update(robot)

    def _update(self, robot: Robot) -> None:
        if robot.update():
            self._on_change(robot.name)


def _robot_of(root: Any) -> str:
    return f"/{str(root.robot).lstrip('/')}"
