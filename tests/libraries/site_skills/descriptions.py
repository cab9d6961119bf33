# ruff: noqa
from skiros2_skill.core.skill import SkillDescription, ParamOptions
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element


class GoTo(SkillDescription):
    def createDescription(self):
        self.addParam("StartLocation", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("RobotAt", "skiros:at", "Robot", "StartLocation", True))
        self.addPostCondition(self.getRelationCond("NoRobotAt", "skiros:at", "Robot", "StartLocation", False))
        self.addPostCondition(self.getRelationCond("AtTarget", "skiros:at", "Robot", "TargetLocation", True))


class PaintWall(SkillDescription):
    def createDescription(self):
        self.addParam("Wall", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Place", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("Colour", "white", ParamTypes.Optional)
        self.addPreCondition(self.getRelationCond("WallAtPlace", "skiros:contain", "Place", "Wall", True))
        self.addPreCondition(self.getRelationCond("RobotAtPlace", "skiros:at", "Robot", "Place", True))
        self.addPreCondition(self.getPropCond("NotPainted", "skiros:Painted", "Wall", "=", False, True))
        self.addPostCondition(self.getPropCond("IsPainted", "skiros:Painted", "Wall", "=", True, True))


class OpenDoor(SkillDescription):
    def createDescription(self):
        self.addParam("Door", Element("skiros:Product"), ParamTypes.Inferred)
        self.addParam("Place", Element("skiros:Location"), ParamTypes.Inferred)
        self.addPreCondition(self.getRelationCond("DoorAtPlace", "skiros:contain", "Place", "Door", True))
        self.addPreCondition(self.getRelationCond("RobotAtPlace", "skiros:at", "Robot", "Place", True))
        self.addPreCondition(self.getPropCond("Closed", "skiros:Open", "Door", "=", False, True))
        self.addPostCondition(self.getPropCond("IsOpen", "skiros:Open", "Door", "=", True, True))


class PullHandle(SkillDescription):
    def createDescription(self):
        self.addParam("Door", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Spare", Element("skiros:Product"), ParamTypes.Optional)
