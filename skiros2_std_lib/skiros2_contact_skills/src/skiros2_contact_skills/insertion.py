"""Trees of an insertion."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from skiros2_common.core.abstract_skill import SkillDescription
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.contact_primitive import NOT_READY
from skiros2_contact_skills.descriptions import add_axis_limits
from skiros2_contact_skills.fit import Fit, fit_of
from skiros2_skill.core.processors import RetryOnFail, SerialStar
from skiros2_skill.core.skill import SkillBase

#: Height above the rim at which an attempt starts (m).
_ABOVE = 0.004
#: The motion from there on: slow, because a stiff contact is hit with the inertia of the arm; a part without contact is
#: inside of the bore after this distance.
_CONTACT = {"Speed": 0.008, "MaxDistance": 0.010, "NeedsContact": False}
#: Of a blind insertion.
_STIFF = {"Stiffness": 2000.0, "RotationalStiffness": 300.0, "Speed": 0.05}


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
        add_axis_limits(self)
        self.addParam(
            "Attempts",
            int,
            ParamTypes.Optional,
            description="At most; without, those of the world model, or 6",
            minimum=1,
        )
        self.addHoldCondition(
            self.getSignalCond(
                "ForceBelowLimit", "skiros:WristForce", "Arm", maximum="MaxForce", timeout=2.0, kind=FailureKind.LIMIT
            )
        )


class insert_into_bore(SkillBase):
    """Searches the rim with the estimated pose of the bore, and inserts; starts again when the part jams, which is
    pulled out before. Depth, search and attempts are those of the part and the bore, see `fit.py`."""

    def createDescription(self) -> None:
        self.setDescription(InsertIntoBore(), self.__class__.__name__)
        self._expand_on_start = True

    def onStart(self) -> bool:
        try:
            self._fit()
        except SkirosError as error:
            return self.startError(str(error), NOT_READY)
        return True

    def _fit(self) -> Fit:
        return fit_of(self.wmi, self.params["Part"].value, self.params["Bore"].value)

    def expand(self, skill: Any) -> None:
        fit = Fit()
        with suppress(SkirosError):  # reported by onStart
            fit = self._fit()
        attempts = self.params["Attempts"].values or [fit.attempts]
        skill.setProcessor(SerialStar())
        skill(
            self.skill(RetryOnFail(attempts[0] - 1, SerialStar()))(
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
            self.skill("ApproachTarget", "", remap={"Target": "Bore"}, specify=_STIFF | {"Height": -Fit().depth}),
        )
