"""Distances between the fingers of grippers, from the joint states of their robots."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

import rospy
from sensor_msgs.msg import JointState

from skiros2_common.core.world_element import Element
from skiros2_motion.core.state_age import StateAge
from skiros2_std_skills.core import driver_names as names
from skiros2_std_skills.core.devices import joint_names


class FingerWidths:
    """Subscribes to the joint states of a robot when a gripper is asked for. Thread-safe."""

    def __init__(self) -> None:
        self._grippers: dict[str, _Fingers | None] = {}
        self._lock = threading.Lock()

    def width(self, robot: Element, gripper: Element) -> float | None:
        """Returns the last distance (m); None if `skiros:JointNames` of the gripper is not set, or no joint states
        arrive. Does not block.

        :raises WrongValue: the property is not a list.
        """
        with self._lock:
            if gripper.id not in self._grippers:
                joints = joint_names(gripper)
                topic = f"/{names.robot_name(robot)}/joint_states"
                self._grippers[gripper.id] = _Fingers(topic, joints) if joints else None
            fingers = self._grippers[gripper.id]
        return fingers.width() if fingers is not None else None


class _Fingers:
    """The sum of the positions of finger joints, which are 0 when closed.

    :param topic: `sensor_msgs/JointState`, of some or all of the joints.
    """

    def __init__(self, topic: str, joints: Sequence[str]) -> None:
        self._joints = joints
        self._width: float | None = None
        self._age = StateAge(rospy.get_time)
        rospy.Subscriber(topic, JointState, self._on_state, queue_size=1)

    def width(self) -> float | None:
        return None if self._age.overdue() else self._width

    def _on_state(self, message: Any) -> None:
        positions = dict(zip(message.name, message.position, strict=False))
        if all(joint in positions for joint in self._joints):
            self._width = sum(positions[joint] for joint in self._joints)
            self._age.receive()
