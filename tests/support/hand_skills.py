"""A library of small skills for tests of the manager as a node: `libraries_list:=[support.hand_skills]`."""

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element


class Add(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("A", 1.0, ParamTypes.Required)
        self.addParam("B", float, ParamTypes.Required)
        self.addParam("Sum", float, ParamTypes.Optional)


class add(PrimitiveBase):
    """Sets an output."""

    def createDescription(self) -> None:
        self.setDescription(Add(), "add")

    def execute(self) -> State:
        self.params["Sum"].value = self.params["A"].value + self.params["B"].value
        return self.success("added")


class Stay(SkillDescription):
    pass


class stay(PrimitiveBase):
    """Runs until it is preempted."""

    def createDescription(self) -> None:
        self.setDescription(Stay(), "stay")

    def execute(self) -> State:
        return State.Running

    def onPreempt(self) -> State:
        return self.fail("stopped", -3)


class Give(SkillDescription):
    pass


class give_up(PrimitiveBase):
    """Fails with a code."""

    def createDescription(self) -> None:
        self.setDescription(Give(), "give_up")

    def execute(self) -> State:
        return self.fail("too heavy", -7)


class Weigh(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Container", Element("skiros:LargeBox"), ParamTypes.Required)
        self.addParam("Object", Element("skiros:Product"), ParamTypes.Inferred)
        self.addPreCondition(self.getRelationCond("InIt", "skiros:contain", "Container", "Object", True))


class weigh(PrimitiveBase):
    """Starts only with a box that has something in it."""

    def createDescription(self) -> None:
        self.setDescription(Weigh(), "weigh")

    def execute(self) -> State:
        return self.success("weighed")
