"""Descriptions of motions of a mobile manipulator, in addition to those of the demo without physics."""

from __future__ import annotations

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element


class ArmAndGripper(SkillDescription):
    """Base of the descriptions with an arm and its gripper, which are inferred if not given."""

    def add_arm_and_gripper(self) -> None:
        """Declares both and their relations."""
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Inferred, description="The robot's arm")
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred, description="Its gripper")
        self.addPreCondition(self.getRelationCond("RobotHasArm", "skiros:hasA", "Robot", "Arm", True))
        self.addPreCondition(self.getRelationCond("ArmHasGripper", "skiros:hasA", "Arm", "Gripper", True))


class MoveArmJoints(SkillDescription):
    """Moves an arm to a named posture."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm")
        self.addParam("Posture", "home", ParamTypes.Required, description="A name in demo:Postures of the arm")
        self.addParam("Duration", 2.5, ParamTypes.Optional, description="How long the motion takes (s)")


class MoveTool(ArmAndGripper):
    """Base of the straight motions of the tool."""

    def add_motion(self, target: str, element_type: str, description: str) -> None:
        """Declares target, height above it, speed and force limit."""
        self.add_arm_and_gripper()
        self.addParam(target, Element(element_type), ParamTypes.Required, description=description)
        self.addParam("Height", 0.0, ParamTypes.Optional, description="How far above (m)")
        self.addParam("Speed", 0.25, ParamTypes.Optional, description="m/s")
        self.addParam("MaxForce", 40.0, ParamTypes.Optional, description="Ends the motion with a failure (N)")


class MoveToolToObject(MoveTool):
    """Moves the tool to the grasp pose of an object, from above."""

    def createDescription(self) -> None:
        self.add_motion("Object", "skiros:Manipulatable", "What to reach for")


class MoveToolToContainer(MoveTool):
    """Moves the tool to the release pose of an object above a container, or down until contact."""

    def createDescription(self) -> None:
        self.add_motion("Container", "skiros:Container", "What to reach for")
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="What it holds")
        self.addParam("ContactForce", 0.0, ParamTypes.Optional, description="Above 0: down until this much is felt (N)")


class LiftTool(ArmAndGripper):
    """Moves the tool back along its axis."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Height", 0.12, ParamTypes.Optional, description="How far (m)")
        self.addParam("Speed", 0.25, ParamTypes.Optional, description="m/s")


class SwitchController(SkillDescription):
    """Switches an arm between position control and compliance."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm")
        self.addParam("Compliant", False, ParamTypes.Required, description="True: it gives way")


class CheckGrasp(ArmAndGripper):
    """Checks that an object is between the fingers; removes a lost one from the gripper in the world model."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="What to hold")


class WatchGrasp(ArmAndGripper):
    """Runs while the gripper holds its object, or is empty; fails when the object is lost."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()


class WmGrasped(ArmAndGripper):
    """Updates the world model after a grasp."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="What it holds")


class DetectObjects(SkillDescription):
    """Updates the world model by the objects that a camera detects, or no longer detects, at a workstation."""

    def createDescription(self) -> None:
        self.addParam("Camera", Element("skiros:DepthCamera"), ParamTypes.Required, description="The camera")
        self.addParam("Workstation", Element("skiros:Location"), ParamTypes.Required, description="What it looks at")
