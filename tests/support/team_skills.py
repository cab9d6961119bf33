"""A library of skills for robots that work together: `libraries_list:=[support.team_skills]`.

Products are carried to a bench, washed and labelled there, and carried on. Each skill takes its time, and what it does
is in the world model at its end, or not at all.
"""

from __future__ import annotations

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_std_skills.clock import Stopwatch

PLACE, PRODUCT = "skiros:Location", "skiros:Product"
WASHED, LABELLED = "skiros:Washed", "skiros:Labelled"


class Carry(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("From", Element(PLACE), ParamTypes.Inferred)
        self.addParam("To", Element(PLACE), ParamTypes.Required)
        self.addParam("Object", Element(PRODUCT), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("IsThere", "skiros:contain", "From", "Object", True))
        self.addPostCondition(self.getRelationCond("HasCome", "skiros:contain", "To", "Object", True))
        self.addPostCondition(self.getRelationCond("HasLeft", "skiros:contain", "From", "Object", False))


class AtBench(SkillDescription):
    def add_bench(self) -> None:
        self.addParam("Bench", Element("skiros:LargeBox"), ParamTypes.Inferred)
        self.addParam("Object", Element(PRODUCT), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("IsThere", "skiros:contain", "Bench", "Object", True))
        self.addHoldCondition(self.getRelationCond("StaysThere", "skiros:contain", "Bench", "Object", True))


class Wash(AtBench):
    def createDescription(self) -> None:
        self.add_bench()
        self.addPostCondition(self.getPropCond("IsWashed", WASHED, "Object", "=", True, True))


class Label(AtBench):
    def createDescription(self) -> None:
        self.add_bench()
        self.addPreCondition(self.getPropCond("IsWashed", WASHED, "Object", "=", True, True))
        self.addPostCondition(self.getPropCond("IsLabelled", LABELLED, "Object", "=", True, True))


class Timed(PrimitiveBase):
    """Runs for `Duration` seconds, then does what it does."""

    def describe(self, description: SkillDescription) -> None:
        self.setDescription(description, type(self).__name__)
        self.addParam("Duration", 0.5, ParamTypes.Optional)

    def arrive(self) -> None:
        raise NotImplementedError

    def onStart(self) -> bool:
        self._stopwatch = Stopwatch()
        return True

    def onPreempt(self) -> State:
        return self.fail("stopped", -1)

    def execute(self) -> State:
        if self._stopwatch.passed() < self.params["Duration"].value:
            return self.step("at work")
        self.arrive()
        return self.success("done")

    def mark(self, key: str) -> None:
        product = self.params["Object"].value
        product.setProperty(key, True)
        self.wmi.update_element_properties(product)


class carry(Timed):
    def createDescription(self) -> None:
        self.describe(Carry())

    def arrive(self) -> None:
        product = self.params["Object"].value
        product.setRelation(self.params["To"].value.id, "skiros:contain", "-1")
        self.wmi.update_element(product)


class wash(Timed):
    def createDescription(self) -> None:
        self.describe(Wash())

    def arrive(self) -> None:
        self.mark(WASHED)


class label(Timed):
    def createDescription(self) -> None:
        self.describe(Label())

    def arrive(self) -> None:
        self.mark(LABELLED)
