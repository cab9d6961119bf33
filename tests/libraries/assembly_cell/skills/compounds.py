# ruff: noqa
from skiros2_skill.core.skill import *
from .descriptions import *


class grasp_simple(SkillBase):
    def createDescription(self):
        self.setDescription(Grasp(), self.__class__.__name__)

    def expand(self, skill):
        skill.setProcessor(SerialStar())
        skill(
            self.skill("ArmMovement", "arm_move", remap={"Target": "Object"}, specify={"Mode": 2}),
            self.skill(
                "WmMoveObject", "wm_move_object", remap={"StartLocation": "Container", "TargetLocation": "Gripper"}
            ),
        )


class put_simple(SkillBase):
    def createDescription(self):
        self.setDescription(Put(), self.__class__.__name__)

    def expand(self, skill):
        skill.setProcessor(SerialStar())
        skill(
            self.skill("ArmMovement", "", remap={"Target": "PlacingLocation"}, specify={"Mode": 3}),
            self.skill(
                "WmMoveObject",
                "wm_move_object",
                remap={"StartLocation": "Gripper", "TargetLocation": "PlacingLocation"},
            ),
        )


class inspect(SkillBase):
    def createDescription(self):
        self.setDescription(Inspect(), self.__class__.__name__)
        self.addParam("Waypoints", dict, ParamTypes.Optional)

    def expand(self, skill):
        skill(
            self.skill("LookAround", ""),
            self.skill(
                "ArmMovement",
                "arm_move",
                remap={"Target": "Found", "Arm": "Hand"},
                specify={"Hand": self._wmi.resolve_element(Element("rparts:ArmDevice"))},
            ),
            self.skill("Follow", "follow"),
        )
