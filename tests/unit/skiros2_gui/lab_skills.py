"""Skills for the window's tests: parameters of all kinds, and conditions that can fail."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element


class Fetch(SkillDescription):
    """Brings a product
    to the robot.

    Not shown.
    """

    def createDescription(self) -> None:
        self.addParam("Box", Element("skiros:LargeBox"), ParamTypes.Inferred, description="Where it lies")
        self.addParam("Thing", Element("skiros:Product"), ParamTypes.Required, description="What to fetch")
        self.addParam("Beside", Element("skiros:Product"), ParamTypes.Optional, description="What to put it beside")
        self.addParam("Speed", 0.5, ParamTypes.Optional, description="How fast", unit="m/s", minimum=0.1, maximum=2)
        self.addParam("Times", int, ParamTypes.Required, description="How often", minimum=1)
        self.addPreCondition(self.getRelationCond("BoxHasThing", "skiros:contain", "Box", "Thing", True))
        self.addPreCondition(self.getHasPropCond("Weighed", "skiros:Weight", "Thing", True))


class fetch(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(Fetch(), "fetch")

    def onPreempt(self) -> State:
        return self.success("stopped")

    def execute(self) -> State:
        return self.step("fetching")


class fetch_gently(fetch):
    def createDescription(self) -> None:
        self.setDescription(Fetch(), "fetch_gently")
        self.addParam("Softness", "soft", ParamTypes.Optional, choices=("soft", "very soft"))


class Note(SkillDescription):
    def createDescription(self) -> None:
        self.addParam("Text", str, ParamTypes.Required, description="What to note")
        self.addParam("Loud", False, ParamTypes.Required)
        self.addParam("Marks", list, ParamTypes.Optional)
        self.addParam("More", dict, ParamTypes.Optional)


class note(PrimitiveBase):
    def createDescription(self) -> None:
        self.setDescription(Note(), "note")

    def execute(self) -> State:
        if self.params["Loud"].value:
            return self.fail("too loud", -7)
        return self.success(self.params["Text"].value)


class Break(SkillDescription):
    def createDescription(self) -> None:
        pass


class break_down(PrimitiveBase):
    """Raises in code of its own library."""

    def createDescription(self) -> None:
        self.setDescription(Break(), "break_down")

    def execute(self) -> State:
        return {"slow": State.Success}["sloow"]


def furnish(wm: Any) -> dict[str, str]:
    """A box with a weighed product, an empty box, and a product that lies beside. Returns the ids by label."""
    ids: dict[str, str] = {}

    def add(etype: str, label: str, container: str = "skiros:Scene-0", weight: float | None = None) -> None:
        element = Element(etype, label)
        if weight is not None:
            element.setProperty("skiros:Weight", weight)
        element.addRelation(container, "skiros:contain", "-1")
        ids[label] = wm.add_element(element).id

    add("skiros:LargeBox", "box")
    add("skiros:LargeBox", "empty box")
    add("skiros:Product", "bolt", ids["box"], 0.2)
    add("skiros:Product", "nut")
    return ids
