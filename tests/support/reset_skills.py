"""A skill that puts a thing of the simulated world back to where the world model has it."""

from __future__ import annotations

import rospy
from geometry_msgs.msg import Point, PoseStamped, Quaternion

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_sim_msgs.srv import SetPose
from skiros2_std_reasoners.core.scene_poses import pose_in_scene


class PutBack(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)


class put_back(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(PutBack(), self.__class__.__name__)

    def execute(self) -> State:
        element = self.params["Object"].value
        frame, pose = pose_in_scene(self.wmi, element)
        target = PoseStamped()
        target.header.frame_id = frame
        target.pose.position, target.pose.orientation = Point(*pose.position), Quaternion(*pose.orientation)
        answer = rospy.ServiceProxy("/sim/set_pose", SetPose)(element=element.id, pose=target)
        return self.success("it is back") if answer.ok else self.fail(answer.message, -1)
