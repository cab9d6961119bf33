from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.skill import ParamOptions, SkillDescription


class Drive(SkillDescription):
    def createDescription(self):
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("StartLocation", Element("skiros:Location"), ParamTypes.Inferred)
        self.addPreCondition(self.getRelationCond("RobotAtStart", "skiros:at", "Robot", "StartLocation", True))
        self.addPostCondition(self.getRelationCond("NotAtStart", "skiros:at", "Robot", "StartLocation", False))
        self.addPostCondition(self.getRelationCond("AtTarget", "skiros:at", "Robot", "TargetLocation", True))


class Pick(SkillDescription):
    def createDescription(self):
        self.addParam("Container", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Inferred)
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred)
        self.addPreCondition(self.getRelationCond("RobotAtLocation", "skiros:at", "Robot", "Container", True))
        self.addPreCondition(self.getRelationCond("ObjectInContainer", "skiros:contain", "Container", "Object", True))
        self.addPreCondition(self.getRelationCond("RobotHasArm", "skiros:hasA", "Robot", "Arm", True))
        self.addPreCondition(self.getRelationCond("ArmHasGripper", "skiros:hasA", "Arm", "Gripper", True))
        self.addPreCondition(self.getPropCond("Empty", "skiros:ContainerState", "Gripper", "=", "Empty", True))
        self.addPostCondition(self.getPropCond("Full", "skiros:ContainerState", "Gripper", "=", "Full", True))
        self.addPostCondition(self.getRelationCond("Holding", "skiros:contain", "Gripper", "Object", True))


class Place(SkillDescription):
    def createDescription(self):
        self.addParam("PlacingLocation", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Inferred)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Inferred)
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred)
        self.addPreCondition(self.getRelationCond("RobotAtLocation", "skiros:at", "Robot", "PlacingLocation", True))
        self.addPreCondition(self.getRelationCond("RobotHasArm", "skiros:hasA", "Robot", "Arm", True))
        self.addPreCondition(self.getRelationCond("ArmHasGripper", "skiros:hasA", "Arm", "Gripper", True))
        self.addPreCondition(self.getRelationCond("Holding", "skiros:contain", "Gripper", "Object", True))
        self.addPostCondition(self.getPropCond("Empty", "skiros:ContainerState", "Gripper", "=", "Empty", True))
        self.addPostCondition(self.getRelationCond("NotHolding", "skiros:contain", "Gripper", "Object", False))
        self.addPostCondition(self.getRelationCond("InPlace", "skiros:contain", "PlacingLocation", "Object", True))


class Fetch(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Container", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("To", Element("skiros:Location"), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("ObjectThere", "skiros:contain", "Container", "Object", True))


class Scan(SkillDescription):
    def createDescription(self):
        self.addParam("Labels", str, ParamTypes.Optional)


class Sort(SkillDescription):
    def createDescription(self):
        self.addParam("Labels", str, ParamTypes.Required)
        self.addParam("Sorted", dict, ParamTypes.Optional)


class Detect(SkillDescription):
    def createDescription(self):
        self.addParam("Container", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("Detected", Element("skiros:Product"), ParamTypes.Optional)


class Weigh(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required, [ParamOptions.RespectType])


class TakeStock(SkillDescription):
    def createDescription(self):
        self.addParam("Container", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("Labels", str, ParamTypes.Optional)
        self.addParam("Sorted", dict, ParamTypes.Optional)


class Watch(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
