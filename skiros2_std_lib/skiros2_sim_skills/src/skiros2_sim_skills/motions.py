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
        self.addParam("Posture", "home", ParamTypes.Required, description="Name in skiros:Postures of the arm")
        self.addParam("Duration", 2.5, ParamTypes.Optional, description="Duration of the motion", unit="s", minimum=0.1)


class MoveArmCollisionFree(SkillDescription):
    """Moves an arm to a named posture, or its tool to a pose, on a planned path without collisions."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm")
        self.addParam(
            "Posture", "", ParamTypes.Optional, description="Name in skiros:Postures of the arm; empty with a target"
        )
        self.addParam(
            "Target",
            Element("skiros:TransformationPose"),
            ParamTypes.Optional,
            description="Pose of the tool; empty with a posture",
        )
        self.addParam(
            "PlanningTime",
            5.0,
            ParamTypes.Optional,
            description="Limit of the search",
            unit="s",
            minimum=0.1,
            maximum=60,
        )
        self.addParam(
            "Clearance",
            0.01,
            ParamTypes.Optional,
            description="Minimum distance from everything else",
            unit="m",
            minimum=0,
            maximum=0.5,
        )
        self.addParam(
            "Speed",
            0.5,
            ParamTypes.Optional,
            description="Fraction of the joints' limits of velocity and acceleration",
            minimum=0.01,
            maximum=1.0,
        )


class MoveTool(ArmAndGripper):
    """Base of the straight motions of the tool."""

    def add_motion(self, target: str, element_type: str, description: str) -> None:
        """Declares target, height above it, speed and force limit."""
        self.add_arm_and_gripper()
        self.addParam(target, Element(element_type), ParamTypes.Required, description=description)
        self.addParam("Height", 0.0, ParamTypes.Optional, description="Height above the target", unit="m")
        self.addParam(
            "Speed", 0.25, ParamTypes.Optional, description="Speed of the tool", unit="m/s", minimum=0.01, maximum=2.0
        )
        self.addParam(
            "MaxForce", 40.0, ParamTypes.Optional, description="Force at which the motion fails", unit="N", minimum=0
        )


class MoveToolToObject(MoveTool):
    """Moves the tool to the grasp pose of an object, from above."""

    def createDescription(self) -> None:
        self.add_motion("Object", "skiros:Manipulatable", "The target of the tool")


class MoveToolToContainer(MoveTool):
    """Moves the tool to the release pose of an object above a container, or down until contact."""

    def createDescription(self) -> None:
        self.add_motion("Container", "skiros:Container", "The target of the tool")
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The held object")
        self.addParam(
            "ContactForce",
            0.0,
            ParamTypes.Optional,
            description="Contact force that ends the motion; 0 for none",
            unit="N",
            minimum=0,
        )


class LiftTool(ArmAndGripper):
    """Moves the tool back along its axis."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Height", 0.12, ParamTypes.Optional, description="Distance", unit="m", minimum=0)
        self.addParam(
            "Speed", 0.25, ParamTypes.Optional, description="Speed of the tool", unit="m/s", minimum=0.01, maximum=2.0
        )


class SwitchController(SkillDescription):
    """Switches an arm between position control and compliance."""

    def createDescription(self) -> None:
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm")
        self.addParam("Compliant", False, ParamTypes.Required, description="Whether the arm yields to forces")


class CheckGrasp(ArmAndGripper):
    """Checks that an object is between the fingers; removes a lost one from the gripper in the world model."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The object to check")


class WatchGrasp(ArmAndGripper):
    """Runs while the gripper holds its object, or is empty; fails when the object is lost."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()


class WmGrasped(ArmAndGripper):
    """Updates the world model after a grasp."""

    def createDescription(self) -> None:
        self.add_arm_and_gripper()
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The held object")


class DetectObjects(SkillDescription):
    """Updates the world model by the objects that a camera detects, or no longer detects, at a workstation."""

    def createDescription(self) -> None:
        self.addParam("Camera", Element("skiros:DepthCamera"), ParamTypes.Required, description="The camera")
        self.addParam("Workstation", Element("skiros:Location"), ParamTypes.Required, description="The workstation")
