"""Trees of an insertion."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.processors import RetryOnFail, SerialStar
from skiros2_skill.core.skill import SkillBase

#: Height above the rim at which an attempt starts (m).
_ABOVE = 0.004
#: The motion from there on: slow, because a stiff contact is hit with the inertia of the arm; a part without contact is
#: inside of the bore after this distance.
_CONTACT = {"Speed": 0.008, "MaxDistance": 0.010, "NeedsContact": False}
#: Of a blind insertion.
_STIFF = {"Stiffness": 2000.0, "RotationalStiffness": 300.0, "Speed": 0.05}
#: Attempts after a jam or a search without result.
_ATTEMPTS = 5


class InsertIntoBore(SkillDescription):
    """Inserts a held part into a bore with a tight fit."""

    def createDescription(self) -> None:
        self.setAvailableForPlanning(False)
        self.addParam("Arm", Element("rparts:ArmDevice"), ParamTypes.Required, description="The arm with the part")
        self.addParam("Part", Element("skiros:Product"), ParamTypes.Required, description="The held part")
        self.addParam("Bore", Element("skiros:Bore"), ParamTypes.Required, description="Where it goes")
        self.addParam(
            "MaxForce", 40.0, ParamTypes.Optional, description="At the wrist", unit="N", minimum=1.0, maximum=200.0
        )
        self.addHoldCondition(
            self.getSignalCond(
                "ForceBelowLimit", "skiros:WristForce", "Arm", maximum="MaxForce", timeout=2.0, kind=FailureKind.LIMIT
            )
        )


class insert_into_bore(SkillBase):
    """Searches the rim with the estimated pose of the bore, and inserts; starts again when the part jams."""

    def createDescription(self) -> None:
        self.setDescription(InsertIntoBore(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(
            self.skill(RetryOnFail(_ATTEMPTS, SerialStar()))(
                self.skill("ApproachTarget", "", remap={"Target": "Bore"}, specify={"Height": _ABOVE}),
                # without contact the part is in the bore already
                self.skill("MoveUntilContact", "", specify=_CONTACT),
                self.skill("SpiralSearch", ""),
                self.skill("InsertPart", ""),
            ),
        )


class insert_blindly(SkillBase):
    """Pushes the part straight down to where the bore is estimated to be: what a stiff arm would do."""

    def createDescription(self) -> None:
        self.setDescription(InsertIntoBore(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())
        skill(
            self.skill("ApproachTarget", "", remap={"Target": "Bore"}, specify=_STIFF | {"Height": _ABOVE}),
            self.skill("ApproachTarget", "", remap={"Target": "Bore"}, specify=_STIFF | {"Height": -0.06}),
        )
