"""A library whose skills hold an object while they run: `libraries_list:=[support.hauling_skills]`.

A product is taken from a place to the robot's gripper, carried, and put to another place. A haul that is preempted
meanwhile puts the product down on the bench.
"""

from __future__ import annotations

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element
from skiros2_std_skills.clock import Stopwatch

GRIPPER, PLACE, PRODUCT = "rparts:GripperEffector", "skiros:Location", "skiros:Product"
TAKEN = "skiros:Taken"  # of the bench: nothing can be put down


class Haul(SkillDescription):
    """Moves a product from one place to another in the gripper."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element(GRIPPER), ParamTypes.Inferred)
        self.addParam("From", Element(PLACE), ParamTypes.Inferred)
        self.addParam("To", Element(PLACE), ParamTypes.Required)
        self.addParam("Object", Element(PRODUCT), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("HasGripper", "skiros:hasA", "Robot", "Gripper", True))
        self.addPreCondition(self.getRelationCond("IsThere", "skiros:contain", "From", "Object", True))
        self.addPostCondition(self.getRelationCond("HasCome", "skiros:contain", "To", "Object", True))
        self.addPostCondition(self.getRelationCond("HasLeft", "skiros:contain", "From", "Object", False))
        holds = self.getRelationCond("Holds", "skiros:contain", "Gripper", "Object", True)
        self.set_on_preempt("PutDown", "", {"Held": "Object"}, holds, 20.0)


class PutDown(SkillDescription):
    """Puts the held product down on the bench, once this is not taken."""

    def createDescription(self) -> None:
        self.addParam("Gripper", Element(GRIPPER), ParamTypes.Inferred)
        self.addParam("Held", Element(PRODUCT), ParamTypes.Required)
        self.addPreCondition(self.getRelationCond("Holds", "skiros:contain", "Gripper", "Held", True))
        self.setAvailableForPlanning(False)


class Timed(PrimitiveBase):
    """Runs for `Duration` seconds."""

    def describe(self, description: SkillDescription, seconds: float) -> None:
        self.setDescription(description, type(self).__name__)
        self.addParam("Duration", seconds, ParamTypes.Optional)

    def onStart(self) -> bool:
        self._stopwatch = Stopwatch()
        return True

    def onPreempt(self) -> State:
        return self.fail("stopped", -1)

    def is_at_work(self) -> bool:
        return bool(self._stopwatch.passed() < self.params["Duration"].value)

    def move(self, product: Element, holder: str) -> None:
        product.setRelation(holder, "skiros:contain", "-1")
        self.wmi.update_element(product)


class haul(Timed):
    def createDescription(self) -> None:
        self.describe(Haul(), 1.0)

    def onStart(self) -> bool:
        self.move(self.params["Object"].value, self.params["Gripper"].value.id)
        return super().onStart()

    def execute(self) -> State:
        if self.is_at_work():
            return self.step("hauling")
        self.move(self.params["Object"].value, self.params["To"].value.id)
        return self.success("done")


class put_down(Timed):
    def createDescription(self) -> None:
        self.describe(PutDown(), 0.3)

    def execute(self) -> State:
        (bench,) = self.wmi.resolve_elements(Element(PLACE, "bench"))
        if self.is_at_work() or bench.value_of(TAKEN):
            return self.step("lowering")
        self.move(self.params["Held"].value, bench.id)
        return self.success("put down")
