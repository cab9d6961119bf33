"""Faults in what descriptions state for their preemption."""

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element


class PutAside(SkillDescription):
    def createDescription(self):
        self.addParam("Held", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Height", float, ParamTypes.Required)
        self.addParam("Speed", 0.5, ParamTypes.Optional)


class put_aside(PrimitiveBase):
    def createDescription(self):
        self.setDescription(PutAside(), "put_aside")

    def execute(self):
        return self.success("")


class Grip(SkillDescription):
    def createDescription(self):
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Required)
        self.addParam("Depth", 0.1, ParamTypes.Optional)
        self.addParam("Speed", 0.5, ParamTypes.Optional)
        self.set_on_preempt("PutAside", "", {"Held": "Object", "Height": "Depth"})


class Gripping(PrimitiveBase):
    def execute(self):
        return self.success("")


class grip(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "grip")


class no_such_handler(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "no_such_handler")
        self.set_on_preempt("PutAway")  # error: unknown-skill


class no_such_label(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "no_such_label")
        self.set_on_preempt("PutAside", "put_away")  # error: unknown-skill


class wrong_bindings(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "wrong_bindings")
        bind = {"Held": "Object", "Heigt": "Depth", "Height": "Depth"}
        self.set_on_preempt("PutAside", "", bind)  # warning: unknown-remap


class wrong_source(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "wrong_source")
        bind = {"Held": "Objekt", "Height": "Depth"}
        self.set_on_preempt("PutAside", "", bind)  # warning: unknown-target


class wrong_type(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "wrong_type")
        bind = {"Held": "Depth", "Height": "Depth"}
        self.set_on_preempt("PutAside", "", bind)  # warning: wrong-type


class never_set(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "never_set")
        self.set_on_preempt("PutAside", "", {"Held": "Object"})  # warning: never-set


class wrong_condition(Gripping):
    def createDescription(self):
        self.setDescription(Grip(), "wrong_condition")
        holds = self.getIsSpecifiedCond("Holds", "Objekt", True)
        self.set_on_preempt("PutAside", "", {"Held": "Object", "Height": "Depth"}, holds)  # warning: unknown-key
