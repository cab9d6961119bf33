"""A primitive for the base with move_base_msgs/MoveBase."""

from __future__ import annotations

import math
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from skiros2_common.core.abstract_skill import State
from skiros2_demo_skills.motions import MoveBase
from skiros2_sim.core.names import MOVE
from skiros2_sim_skills.core.devices import name_of
from skiros2_sim_skills.core.places import approach_pose
from skiros2_sim_skills.drivers import DriverAction
from skiros2_std_reasoners.core.geometry import Pose


class move_base(DriverAction):
    """Drives to the approach pose of the place; without one, to the place itself."""

    def createDescription(self) -> None:
        self.setDescription(MoveBase(), self.__class__.__name__)

    def address(self) -> tuple[str, Any]:
        return name_of(MOVE, self.element("Robot")), MoveBaseAction

    def doing(self) -> str:
        return f"Driving to {self.label_of('TargetLocation')}"

    def buildGoal(self) -> MoveBaseGoal:
        frame, pose = approach_pose(self.wmi, self.element("TargetLocation"))
        self._target = pose
        return MoveBaseGoal(target_pose=stamped(frame, pose))

    def onFeedback(self, msg: Any) -> State:
        here = msg.base_position.pose.position
        to_go = math.dist((here.x, here.y), self._target.position[:2])
        return self.step(f"{self.doing()}: {to_go:.1f} m to go")

    def onDone(self, status: int, msg: Any) -> State:
        if status == GoalStatus.SUCCEEDED:
            return self.success(f"{self.doing()}: there")
        return self.failed(self.status_text(), status)


def stamped(frame: str, pose: Pose) -> PoseStamped:
    """Creates a stamped pose with time 0: the driver uses the latest transform of the frame."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.header.stamp = rospy.Time(0)
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = pose.position
    orientation.x, orientation.y, orientation.z, orientation.w = pose.orientation
    return message
