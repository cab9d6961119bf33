# ruff: noqa
from skiros2_skill.core.skill import SkillDescription, ParamOptions
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.conditions import ConditionFunction


class Approach(SkillDescription):
    """No createDescription: no parameters but Robot, no conditions."""


class Go(SkillDescription):
    def createDescription(self):
        # =======Params=========
        self.addParam("StartLocation", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("TargetLocation", Element("skiros:Location"), ParamTypes.Required)
        # =======PreConditions=========
        self.addPreCondition(self.getRelationCond("RobotAt", "skiros:at", "Robot", "StartLocation", True))
        # =======PostConditions=========
        self.addPostCondition(self.getRelationCond("NoRobotAt", "skiros:at", "Robot", "StartLocation", False))
        self.addPostCondition(self.getRelationCond("RobotAt", "skiros:at", "Robot", "TargetLocation", True))


class Grab(SkillDescription):
    def createDescription(self):
        # =======Params=========
        self.addParam("Container", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Inferred, [ParamOptions.Lock])
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred)
        self.addParam("Force", 20.0, ParamTypes.Optional, "How firmly to hold it (N)")
        self.addParam("Offsets", [0.0, 0.0, 0.1], ParamTypes.Optional, description="x, y, z (m)")
        self.addParam("Grasped", str, ParamTypes.Optional, ParamOptions.Output)
        # =======PreConditions=========
        self.addPreCondition(self.getRelationCond("RobotHasArm", "skiros:hasA", "Robot", "Arm", True))
        self.addPreCondition(self.getRelationCond("ArmHasGripper", "skiros:hasA", "Arm", "Gripper", True))
        self.addPreCondition(self.getPropCond("EmptyHanded", "skiros:ContainerState", "Gripper", "=", "Empty", True))
        self.addPreCondition(self.getRelationCond("ObjectInContainer", "skiros:contain", "Container", "Object", True))
        self.addPreCondition(self.getRelationCond("RobotAtLocation", "skiros:at", "Robot", "Container", True))
        # =======HoldConditions=========
        self.addHoldCondition(self.getRelationCond("RobotStays", "skiros:at", "Robot", "Container", True))
        # =======PostConditions=========
        self.addPostCondition(self.getPropCond("EmptyHanded", "skiros:ContainerState", "Gripper", "=", "Empty", False))
        self.addPostCondition(self.getRelationCond("Holding", "skiros:contain", "Gripper", "Object", True))


class Drop(SkillDescription):
    def createDescription(self):
        self.addParam("PlacingLocation", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("Gripper", Element("rparts:GripperEffector"), ParamTypes.Inferred)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Inferred)
        self.addPreCondition(self.getRelationCond("Holding", "skiros:contain", "Gripper", "Object", True))
        self.addPreCondition(self.getRelationCond("RobotAtLocation", "skiros:at", "Robot", "PlacingLocation", True))
        self.addPostCondition(self.getRelationCond("InPlace", "skiros:contain", "PlacingLocation", "Object", True))
        self.addPostCondition(self.getPropCond("EmptyHanded", "skiros:ContainerState", "Gripper", "=", "Empty", True))


class Bring(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("From", Element("skiros:Location"), ParamTypes.Inferred)
        self.addParam("To", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("Tries", 2, ParamTypes.Optional)
        self.addParam("Report", dict, ParamTypes.Optional)
        self.addPreCondition(self.getRelationCond("There", "skiros:contain", "From", "Object", True))
        cond = self.getOrCond(True)
        cond.addCondition(self.getHasPropCond("Known", "skiros:Weight", "Object", True))
        cond.addCondition(self.getPropCond("Any", "skiros:Weight", "Object", ">", 0.0, False))
        self.addPreCondition(cond)


class Look(SkillDescription):
    def createDescription(self):
        self.addParam("Place", Element("skiros:Location"), ParamTypes.Required)
        self.addParam("Seen", Element("skiros:Product"), ParamTypes.Optional)
        self.addPostCondition(self.getGenerateCond("SeesSomething", "Seen", True))


class Scrap(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required, [ParamOptions.Consume])
        self.addParam("Old Label/Name", str, ParamTypes.Optional, [ParamOptions.Unspecify])


class Check(SkillDescription):
    def createDescription(self):
        self.addParam("Value", float, ParamTypes.Required)
        self.addParam("Limit", 10.0, ParamTypes.Required)
        self.addPreCondition(ConditionFunction("BelowLimit", ["Value", "Limit"], lambda v, l: v is not None and v < l))
