"""A gripper with the action control_msgs/GripperCommand, whose position is the width between the fingers (m)."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus

from control_msgs.msg import GripperCommandAction, GripperCommandActionGoal, GripperCommandGoal
from skiros2_common.core.world_element import Element
from skiros2_common.ros.connections import ServerWatch, send_goal
from skiros2_motion.core.gripper import GripperEvent
from skiros2_std_skills.core.driver_names import GRIPPER, part_name, robot_name

#: Time in which the server has to connect (s of wall time).
_CONNECTING = 5.0


class ActionGripper:
    """A client of the action. The topic of its goals also has the commands of other clients.

    :param name: of the action.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._commands: list[GripperEvent] = []
        self._goal: GripperCommandGoal | None = None
        self._is_sent = False
        self._client = actionlib.SimpleActionClient(name, GripperCommandAction)
        self._watch = ServerWatch(self._client)
        self._listener = rospy.Subscriber(f"{name}/goal", GripperCommandActionGoal, self._on_goal)

    @classmethod
    def of(cls, robot: Element, arm: Element, gripper: Element) -> ActionGripper:
        """Connects the gripper of an element."""
        del arm
        return cls(GRIPPER.of(gripper, robot_name(robot), part_name(gripper)))

    def command(self, width: float, effort: float) -> None:
        self._goal, self._is_sent = GripperCommandGoal(), False
        self._goal.command.position, self._goal.command.max_effort = width, effort
        self._watch = ServerWatch(self._client)
        self._send()

    def result(self) -> str | None:
        if not self._is_sent:
            self._send()
            if self._is_sent or self._watch.age() < _CONNECTING:
                return None
            return f"action server {self._name} is not available"
        status = self._client.get_state()
        if status in (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.RECALLING, GoalStatus.PREEMPTING):
            return None
        result = self._client.get_result()
        if status == GoalStatus.SUCCEEDED or getattr(result, "stalled", False):
            return ""
        return self._client.get_goal_status_text() or f"{self._name} has ended with status {status}"

    def commands(self) -> Sequence[GripperEvent]:
        with self._lock:
            return tuple(self._commands)

    def close(self) -> None:
        if self._is_sent and self.result() is None:
            self._client.cancel_goal()
        self._client.stop_tracking_goal()
        self._listener.unregister()
        self._client.action_client.stop()

    def _send(self) -> None:
        if self._watch.is_connected():
            send_goal(self._client, self._goal)
            self._is_sent = True

    def _on_goal(self, message: GripperCommandActionGoal) -> None:
        command = message.goal.command
        with self._lock:
            self._commands.append(GripperEvent(rospy.get_time(), command.position, command.max_effort))
