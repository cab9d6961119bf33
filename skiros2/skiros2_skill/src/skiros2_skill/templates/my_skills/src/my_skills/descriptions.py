"""Descriptions of the skills: parameters and conditions. Planning uses these."""

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element


class Drive(SkillDescription):
    """Drives the robot from one location to another."""

    def createDescription(self):
        self.addParam("StartLocation", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("RobotAtStart", "skiros:at", "Robot", "StartLocation", True))
        self.addPreCondition(self.getRelationCond("RobotElsewhere", "skiros:at", "Robot", "TargetLocation", False))
        self.addPostCondition(self.getRelationCond("RobotHasLeft", "skiros:at", "Robot", "StartLocation", False))
        self.addPostCondition(self.getRelationCond("RobotAtTarget", "skiros:at", "Robot", "TargetLocation", True))


class Inspect(SkillDescription):
    """Inspects an object at the robot's location."""

    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required, description="What to inspect")
        self.addParam("Location", Element("skiros:Location"), ParamTypes.Inferred, description="Where it is")
        self.addPreCondition(self.getRelationCond("ObjectAtLocation", "skiros:contain", "Location", "Object", True))
        self.addPreCondition(self.getRelationCond("RobotAtLocation", "skiros:at", "Robot", "Location", True))
        self.addPostCondition(self.getPropCond("ObjectInspected", "my_skills:Inspected", "Object", "=", True, True))


class TakePicture(SkillDescription):
    """Takes a picture of an object."""

    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Exposure", 0.5, ParamTypes.Optional, unit="s", minimum=0.01, maximum=10.0)
