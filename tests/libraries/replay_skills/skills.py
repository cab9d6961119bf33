"""A gripper that is closed while something else goes on."""

from __future__ import annotations

from typing import Any

import actionlib

from control_msgs.msg import GripperCommand, GripperCommandAction, GripperCommandGoal
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.params import ParamTypes
from skiros2_skill.core.processors import ParallelFf
from skiros2_skill.core.skill import SkillBase
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient

GRIPPER = "/gripper"


class Grasp(SkillDescription):
    """Closes a gripper."""

    def createDescription(self) -> None:
        self.addParam("Width", 0.05, ParamTypes.Optional)


class grasp(PrimitiveActionClient):
    """Tells how far the fingers are; fails when they have closed on nothing."""

    def createDescription(self) -> None:
        self.setDescription(Grasp(), "grasp")

    def buildClient(self) -> Any:
        return actionlib.SimpleActionClient(GRIPPER, GripperCommandAction)

    def buildGoal(self) -> Any:
        return GripperCommandGoal(GripperCommand(self.params["Width"].value, 20.0))

    def onFeedback(self, msg: Any) -> State:
        return self.step(f"{msg.position:.3f} m open")

    def onDone(self, status: int, msg: Any) -> State:
        return self.success("holds something") if msg.stalled else self.fail("holds nothing", 3)


class GraspAndWait(SkillDescription):
    """Closes a gripper and waits meanwhile."""


class grasp_and_wait(SkillBase):
    """The two side by side; ends when both have."""

    def createDescription(self) -> None:
        self.setDescription(GraspAndWait(), "grasp_and_wait")

    def expand(self, skill: Any) -> None:
        skill.setProcessor(ParallelFf())
        skill(
            self.skill("Grasp", "grasp"),
            self.skill("Wait", "wait", specify={"Duration": 0.3}),
        )
