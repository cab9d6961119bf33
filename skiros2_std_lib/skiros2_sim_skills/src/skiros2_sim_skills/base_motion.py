"""Primitives for the base: with move_base_msgs/MoveBase, and for a robot that cannot drive."""

from __future__ import annotations

import math

import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseFeedback, MoveBaseGoal, MoveBaseResult

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_demo_skills.motions import MoveBase
from skiros2_motion.core.geometry import Pose
from skiros2_std_reasoners.core.places import approach_pose
from skiros2_std_reasoners.core.scene_poses import pose_in_scene
from skiros2_std_skills.core.devices import name_of
from skiros2_std_skills.core.driver_names import MOVE
from skiros2_std_skills.drivers import DriverAction

#: Maximum distance (m) of a robot from the place where it stands.
_NEAR = 0.1


class move_base(DriverAction):
    """Drives to the approach pose of the place; without one, to the place itself."""

    def createDescription(self) -> None:
        self.setDescription(MoveBase(), self.__class__.__name__)

    def address(self) -> tuple[str, type]:
        return name_of(MOVE, self.element("Robot")), MoveBaseAction

    def doing(self) -> str:
        return f"Driving to {self.label_of('TargetLocation')}"

    def buildGoal(self) -> MoveBaseGoal:
        frame, pose = approach_pose(self.wmi, self.element("TargetLocation"))
        self._target = pose
        return MoveBaseGoal(target_pose=stamped(frame, pose))

    def onFeedback(self, msg: MoveBaseFeedback) -> State:
        here = msg.base_position.pose.position
        to_go = math.dist((here.x, here.y), self._target.position[:2])
        return self.step(f"{self.doing()}: {to_go:.1f} m to go")

    def onDone(self, status: int, msg: MoveBaseResult) -> State:
        if status == GoalStatus.SUCCEEDED:
            return self.success(f"{self.doing()}: there")
        return self.failed(self.status_text(), status)


class stand_still(PrimitiveBase):
    """Succeeds if the robot stands at the place. Implements `MoveBase` for robots that cannot drive."""

    def createDescription(self) -> None:
        self.setDescription(MoveBase(), self.__class__.__name__)

    def execute(self) -> State:
        robot, place = self.params["Robot"].value, self.params["TargetLocation"].value
        try:
            here = pose_in_scene(self.wmi, self.wmi.get_element(robot.id))[1].position
            there = approach_pose(self.wmi, place)[1].position
        except SkirosError as error:
            return self.fail(f"The distance of {robot.label} from {place.label} is unknown: {error}", -1)
        far = math.dist(here[:2], there[:2])
        if far > _NEAR:
            return self.fail(f"{robot.label} cannot drive, and {place.label} is {far:.2f} m away", -2)
        return self.success(f"At {place.label}")


def stamped(frame: str, pose: Pose) -> PoseStamped:
    """Creates a stamped pose with time 0: the driver uses the latest transform of the frame."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.header.stamp = rospy.Time(0)
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = pose.position
    orientation.x, orientation.y, orientation.z, orientation.w = pose.orientation
    return message
