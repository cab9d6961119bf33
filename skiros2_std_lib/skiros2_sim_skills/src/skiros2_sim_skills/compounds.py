"""How a mobile manipulator drives, looks, picks and places: compounds of motions.

The motions are named by type, so any implementation of them that is loaded will do.
"""

from __future__ import annotations

from typing import Any

from skiros2_demo_skills.transport_skills import FROM
from skiros2_sim_skills.transport import FREE, OBSERVED, Drive, Look, Pick, Place
from skiros2_skill.core.processors import ParallelFs, Sequential
from skiros2_skill.core.skill import SkillBase

#: Where the tool comes to before it goes down, and to where it goes up again, above where it takes or puts things (m).
CLEARANCE = 0.12
#: Near things the arm goes slowly, and gives way (m/s).
SLOWLY = 0.08
#: What is put down has touched the ground when this is felt (N).
TOUCH = 6.0


class drive(SkillBase):
    """Moves the base, with an eye on what the gripper holds; then tells the world model where the robot is."""

    def createDescription(self) -> None:
        self.setDescription(Drive(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            _tell(self, "StartLocation", OBSERVED, False),
            self.skill(ParallelFs())(
                self.skill("MoveBase", ""),
                self.skill("WatchGrasp", ""),
            ),
            self.skill(
                "WmSetRelation",
                "wm_set_relation",
                remap={"Src": "Robot", "Dst": "TargetLocation", "OldDstToRemove": "StartLocation"},
                specify={"Relation": "skiros:at", "RelationState": True},
            ),
            _tell(self, "TargetLocation", FREE, False),
            _tell(self, "StartLocation", FREE, True),
        )


class look(SkillBase):
    """Goes to where the workstation is in view, and tells the world model what is seen."""

    def createDescription(self) -> None:
        self.setDescription(Look(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            self.skill("MoveBase", "", remap={"TargetLocation": "Workstation"}),
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("TuckArm", ""),
            self.skill("DetectObjects", ""),
            _tell(self, "Workstation", OBSERVED, True),
        )


class pick(SkillBase):
    """Grasps the object from above, and lifts it. It is in the gripper when it still is there at the end."""

    def createDescription(self) -> None:
        self.setDescription(Pick(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            _tell(self, "Workstation", OBSERVED, False),
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("OpenGripper", ""),
            self.skill("MoveToolToObject", "", specify={"Height": CLEARANCE}),
            self.skill("SwitchController", "", specify={"Compliant": True}),
            self.skill("MoveToolToObject", "", specify={"Speed": SLOWLY}),
            self.skill("CloseGripper", ""),
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("LiftTool", "", specify={"Height": CLEARANCE}),
            self.skill("CheckGrasp", ""),
            self.skill("TuckArm", ""),
            self.skill("CheckGrasp", ""),
            self.skill("WmGrasped", ""),
            _tell(self, "Workstation", OBSERVED, True),
        )


class place(SkillBase):
    """Puts the object down until it touches the tray, lets go of it, and looks whether it stands there."""

    def createDescription(self) -> None:
        self.setDescription(Place(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            _tell(self, "Workstation", OBSERVED, False),
            self.skill("CheckGrasp", ""),
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("MoveToolToContainer", "", specify={"Height": CLEARANCE}),
            self.skill("SwitchController", "", specify={"Compliant": True}),
            self.skill("MoveToolToContainer", "", specify={"Speed": SLOWLY, "ContactForce": TOUCH}),
            self.skill("OpenGripper", ""),
            self.skill("WmMoveObject", "wm_move_object", remap=FROM | {"TargetLocation": "Container"}),
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("LiftTool", "", specify={"Height": CLEARANCE}),
            self.skill("TuckArm", ""),
            self.skill("DetectObjects", ""),
            _tell(self, "Workstation", OBSERVED, True),
        )


def _tell(skill: SkillBase, element: str, key: str, value: bool) -> Any:
    """A node that sets a property of the element in a parameter."""
    return skill.skill("WmSetProperties", "", remap={"Src": element}, specify={"Properties": {key: value}})
