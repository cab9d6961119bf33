"""The skills of a mobile manipulator: drive, pick and place.

Planning uses their conditions. The compounds reference motions by type; any loaded implementation can be selected.
"""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.processors import Sequential
from skiros2_skill.core.skill import SkillBase

CONTAINER_STATE = "skiros:ContainerState"
#: Remap for WmMoveObject, which infers the start location of the object; it must not use Drive's StartLocation.
FROM = {"StartLocation": "PlaceOfObject"}


class Drive(SkillDescription):
    """Drives the robot from one location to another."""

    def createDescription(self) -> None:
        self.addParam("StartLocation", Element("skiros:Location"), ParamTypes.Inferred, description="The present place")
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required, description="The destination")
        self.addPreCondition(self.getRelationCond("RobotAtStart", "skiros:at", "Robot", "StartLocation", True))
        self.addPreCondition(self.getRelationCond("RobotElsewhere", "skiros:at", "Robot", "TargetLocation", False))
        self.addPostCondition(self.getRelationCond("RobotAtTarget", "skiros:at", "Robot", "TargetLocation", True))
        self.addPostCondition(self.getRelationCond("RobotHasLeft", "skiros:at", "Robot", "StartLocation", False))


class Manipulation(SkillDescription):
    """Base of the descriptions of skills that use the arm on a container at a workstation."""

    def add_common(self) -> None:
        """Declares workstation, arm and gripper, and their relations to the robot and the container."""
        self.addParam("Workstation", Element("demo:Workstation"), ParamTypes.Inferred, description="The workstation")
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Inferred, description="The robot's arm")
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred, description="The gripper")
        at_workstation = self.getRelationCond("RobotAtWorkstation", "skiros:at", "Robot", "Workstation", True)
        self.addPreCondition(self.getRelationCond("RobotHasArm", "skiros:hasA", "Robot", "Arm", True))
        self.addPreCondition(self.getRelationCond("ArmHasGripper", "skiros:hasA", "Arm", "Gripper", True))
        self.addPreCondition(at_workstation)
        self.addPreCondition(
            self.getRelationCond("ContainerAtWorkstation", "skiros:contain", "Workstation", "Container", True)
        )
        self.addHoldCondition(at_workstation)


class Pick(Manipulation):
    """Picks an object from a container at a workstation."""

    def createDescription(self) -> None:
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The object to pick")
        self.addParam("Container", Element("skiros:Container"), ParamTypes.Inferred, description="Its container")
        self.add_common()
        self.addPreCondition(self.getRelationCond("ObjectInContainer", "skiros:contain", "Container", "Object", True))
        self.addPreCondition(self.getPropCond("GripperEmpty", CONTAINER_STATE, "Gripper", "=", "Empty", True))
        self.addPostCondition(self.getRelationCond("ObjectInGripper", "skiros:contain", "Gripper", "Object", True))
        self.addPostCondition(
            self.getRelationCond("ObjectNotInContainer", "skiros:contain", "Container", "Object", False)
        )
        self.addPostCondition(self.getPropCond("GripperNotEmpty", CONTAINER_STATE, "Gripper", "=", "Empty", False))
        self.addPostCondition(self.getPropCond("GripperFull", CONTAINER_STATE, "Gripper", "=", "Full", True))


class Place(Manipulation):
    """Places the object in the gripper into a container at a workstation."""

    def createDescription(self) -> None:
        self.addParam("Object", Element("skiros:Manipulatable"), ParamTypes.Required, description="The object to place")
        self.addParam("Container", Element("skiros:Container"), ParamTypes.Required, description="The destination")
        self.add_common()
        self.addPreCondition(self.getRelationCond("ObjectInGripper", "skiros:contain", "Gripper", "Object", True))
        self.addPostCondition(self.getRelationCond("ObjectInContainer", "skiros:contain", "Container", "Object", True))
        self.addPostCondition(self.getRelationCond("ObjectNotInGripper", "skiros:contain", "Gripper", "Object", False))
        self.addPostCondition(self.getPropCond("GripperNotFull", CONTAINER_STATE, "Gripper", "=", "Full", False))
        self.addPostCondition(self.getPropCond("GripperEmpty", CONTAINER_STATE, "Gripper", "=", "Empty", True))


class drive(SkillBase):
    """Moves the base, then updates the robot's location in the world model."""

    def createDescription(self) -> None:
        self.setDescription(Drive(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            self.skill("MoveBase", ""),
            self.skill(
                "WmSetRelation",
                "wm_set_relation",
                remap={"Src": "Robot", "Dst": "TargetLocation", "OldDstToRemove": "StartLocation"},
                specify={"Relation": "skiros:at", "RelationState": True},
            ),
        )


class pick(SkillBase):
    """Reaches for the object, grasps it, and tucks the arm. The object is then at the origin of the gripper."""

    def createDescription(self) -> None:
        self.setDescription(Pick(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            self.skill("MoveArm", "", remap={"Target": "Object"}),
            self.skill("CloseGripper", ""),
            self.skill("WmMoveObject", "wm_move_object", remap=FROM | {"TargetLocation": "Gripper"}),
            self.skill("WmSetProperties", "", remap={"Src": "Object"}, specify={"Properties": at_height(0.0)}),
            self.skill("TuckArm", ""),
        )


class place(SkillBase):
    """Reaches for the container, releases the object, and tucks the arm. The object then stands in the container."""

    def createDescription(self) -> None:
        self.setDescription(Place(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            self.skill("MoveArm", "", remap={"Target": "Container"}),
            self.skill("OpenGripper", ""),
            self.skill("WmMoveObject", "wm_move_object", remap=FROM | {"TargetLocation": "Container"}),
            self.skill("WmSetProperties", "", remap={"Src": "Object"}, specify={"Properties": at_height(0.06)}),
            self.skill("TuckArm", ""),
        )


def at_height(height: float) -> dict[str, float]:
    """Returns the properties of a position `height` metres above the origin of the parent."""
    return {"skiros:PositionX": 0.0, "skiros:PositionY": 0.0, "skiros:PositionZ": height}
