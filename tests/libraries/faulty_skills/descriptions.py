"""Faults in descriptions, and in what implementations make of them."""

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element


class Fetch(SkillDescription):
    def createDescription(self):
        self.addParam("Container", Element("skiros:Container"), ParamTypes.Inferred)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Speed", 0.5, ParamTypes.Optional)
        self.addPreCondition(self.getRelationCond("Holds", "skiros:contain", "Container", "Object", True))


class unknown_key(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "unknown_key")
        self.addPreCondition(self.getRelationCond("Near", "skiros:at", "Robot", "Objekt", True))  # warning: unknown-key
        self.addHoldCondition(self.getPropCond("Fast", "skiros:Value", "Sped", ">", 1, True))  # warning: unknown-key
        self.addPostCondition(self.getIsSpecifiedCond("Done", "Nothing", True))  # warning: unknown-key

    def execute(self):
        return self.success("")


class unknown_key_in_or(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "unknown_key_in_or")
        either = self.getOrCond(True)
        either.addCondition(self.getRelationCond("One", "skiros:contain", "Container", "Object", True))
        either.addCondition(self.getRelationCond("Other", "skiros:contain", "Box", "Object", True))
        self.addPreCondition(either)  # warning: unknown-key

    def execute(self):
        return self.success("")


class unknown_names(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "unknown_names")
        self.addParam("Part", Element("skiros:Prodcut"), ParamTypes.Optional)  # warning: unknown-class
        condition = self.getRelationCond("Of", "skiros:contian", "Container", "Object", True)
        self.addPreCondition(condition)  # warning: unknown-relation
        self.addPreCondition(self.getHasPropCond("Has", "skiros:Weigth", "Object", True))  # warning: unknown-property
        self.addPreCondition(self.getOnTypeCond("Is", "Object", "skiros:Boxx"))  # warning: unknown-class

    def execute(self):
        return self.success("")


class not_an_element(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "not_an_element")
        condition = self.getRelationCond("In", "skiros:contain", "Container", "Speed", True)
        self.addPreCondition(condition)  # warning: wrong-type

    def execute(self):
        return self.success("")


class contradiction(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "contradiction")
        condition = self.getRelationCond("Empty", "skiros:contain", "Container", "Object", False)
        self.addPreCondition(condition)  # warning: contradiction

    def execute(self):
        return self.success("")


class hold_against_pre(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "hold_against_pre")
        condition = self.getRelationCond("Gone", "skiros:contain", "Container", "Object", False)
        self.addHoldCondition(condition)  # warning: contradiction

    def execute(self):
        return self.success("")


class widened(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "widened")
        self.addParam("Object", Element("sumo:Object"), ParamTypes.Required)  # warning: contradicts-description
        self.addParam("Speed", "fast", ParamTypes.Optional)  # warning: contradicts-description

    def execute(self):
        return self.success("")


class dropped(PrimitiveBase):  # warning: contradicts-description
    def createDescription(self):
        self.setDescription(Fetch(), "dropped")
        del self.params.getParamMap()["Speed"]

    def execute(self):
        return State.Success


class raises(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Fetch(), "raises")
        self.addParam("Mixed", [1, "two"], ParamTypes.Optional)  # error: not-described

    def execute(self):
        return self.success("")
