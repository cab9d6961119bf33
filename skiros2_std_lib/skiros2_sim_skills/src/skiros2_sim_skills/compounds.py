"""Compounds of a mobile manipulator: drive, look, pick and place.

The motions are referenced by type; any loaded implementation can be selected.
"""

from __future__ import annotations

from typing import Any

from skiros2_demo_skills.transport_skills import FROM
from skiros2_sim_skills.transport import FREE, OBSERVED, Drive, Look, Pick, Place
from skiros2_skill.core.processors import ParallelFs, Sequential
from skiros2_skill.core.skill import SkillBase

#: Height of the tool above an object before grasping and after releasing (m).
CLEARANCE = 0.12
#: Speed of a compliant motion near objects (m/s).
SLOWLY = 0.08
#: Contact force of an object that is put down (N).
TOUCH = 6.0


class drive(SkillBase):
    """Moves the base while the grasp is watched, then updates the robot's location in the world model."""

    def createDescription(self) -> None:
        self.setDescription(Drive(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            _set_property(self, "StartLocation", OBSERVED, False),
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
            _set_property(self, "TargetLocation", FREE, False),
            _set_property(self, "StartLocation", FREE, True),
        )


class look(SkillBase):
    """Drives to the workstation, and updates the world model by what the camera sees there."""

    def createDescription(self) -> None:
        self.setDescription(Look(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            self.skill("MoveBase", "", remap={"TargetLocation": "Workstation"}),
            self.skill("SwitchController", "", specify={"Compliant": False}),
            self.skill("TuckArm", ""),
            self.skill("DetectObjects", ""),
            _set_property(self, "Workstation", OBSERVED, True),
        )


class pick(SkillBase):
    """Grasps the object from above and lifts it. Moves it to the gripper in the world model after the last check."""

    def createDescription(self) -> None:
        self.setDescription(Pick(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            _set_property(self, "Workstation", OBSERVED, False),
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
            _set_property(self, "Workstation", OBSERVED, True),
        )


class place(SkillBase):
    """Puts the object into the tray until contact, releases it, and checks with the camera that it is there."""

    def createDescription(self) -> None:
        self.setDescription(Place(), self.__class__.__name__)

    def expand(self, skill: Any) -> None:
        skill.setProcessor(Sequential())
        skill(
            _set_property(self, "Workstation", OBSERVED, False),
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
            _set_property(self, "Workstation", OBSERVED, True),
        )


def _set_property(skill: SkillBase, element: str, key: str, value: bool) -> Any:
    """Creates a node that sets a property of the element in a parameter."""
    return skill.skill("WmSetProperties", "", remap={"Src": element}, specify={"Properties": {key: value}})
