"""Descriptions of the motions of a mobile manipulator."""

from __future__ import annotations

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element


class MoveBase(SkillDescription):
    """Drives the robot to a location and updates its pose in the world model."""

    def createDescription(self) -> None:
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required, description="The destination")


class MoveArm(SkillDescription):
    """Moves the tool of an arm to an object or a container."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm")
        self.addParam("Target", Element("sumo:Object"), ParamTypes.Required, description="The element to reach")


class TuckArm(SkillDescription):
    """Moves an arm to a posture in which the robot can drive safely."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm")


class OpenGripper(SkillDescription):
    """Opens a gripper."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Required, description="The gripper")


class CloseGripper(SkillDescription):
    """Closes a gripper on an object."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Required, description="The gripper")
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The object to grasp")
