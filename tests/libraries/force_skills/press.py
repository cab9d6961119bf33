"""Presses until it is stopped, or the force at the wrist exceeds a limit."""

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.world_element import Element


class Press(SkillDescription):
    def createDescription(self):
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required)
        self.addParam("MaxForce", 30.0, ParamTypes.Required, unit="N", minimum=0.0)
        self.addHoldCondition(
            self.getSignalCond("ForceBelowLimit", "skiros:WristForce", "Arm", maximum="MaxForce", hysteresis=2.0)
        )


class press(PrimitiveBase):
    def createDescription(self):
        self.setDescription(Press(), "press")

    def execute(self):
        return self.step("pressing")
