"""Skills that use a ROS action server."""

import actionlib
from control_msgs.msg import GripperCommandAction, GripperCommandGoal

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient


class MoveGripper(SkillDescription):
    """Opens or closes a gripper."""

    def createDescription(self):
        self.addParam("Opening", 0.08, ParamTypes.Required, description="Between the fingers", unit="m", minimum=0.0)
        self.addParam("Action", "gripper/gripper_action", ParamTypes.Optional, description="The gripper's action")


class move_gripper(PrimitiveActionClient):
    """Sends a goal to the gripper's action server, without blocking the tree."""

    def createDescription(self):
        self.setDescription(MoveGripper(), "move_gripper")

    def buildClient(self):
        return actionlib.SimpleActionClient(self.params["Action"].value, GripperCommandAction)

    def buildGoal(self):
        goal = GripperCommandGoal()
        goal.command.position = self.params["Opening"].value
        return goal

    def onFeedback(self, msg):
        return self.step(f"{msg.position * 1000:.0f} mm")
