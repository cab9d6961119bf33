"""Achieving a goal as a skill, with all available robots."""

from __future__ import annotations

import json
from typing import Any

import actionlib
from actionlib_msgs.msg import GoalStatus

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.explanation import Explanation, worst_kind
from skiros2_common.core.manager_names import manager_of
from skiros2_common.core.params import ParamTypes
from skiros2_msgs.msg import AchieveAction, AchieveGoal
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION


class Achieve(SkillDescription):
    """Achieves a goal: plans for it, executes the plan on the robots, and replans after a failure."""

    def createDescription(self) -> None:
        self.addParam("Goal", str, ParamTypes.Required, description="PDDL goals, separated by commas")
        self.addParam("Priority", 0, ParamTypes.Optional, description="Goals of high priority get robots first")
        self.addParam(
            "MaxReplans", -1, ParamTypes.Optional, description="Maximum number of new plans; negative: the default"
        )


class achieve(PrimitiveActionClient):
    """Sends the goal to the task manager. Unlike those of `task_plan`, the steps are separate tasks of any manager."""

    build_client_onstart = False

    def createDescription(self) -> None:
        self.setDescription(Achieve(), self.__class__.__name__)

    def buildClient(self) -> Any:
        return actionlib.SimpleActionClient(ACHIEVE_ACTION, AchieveAction)

    def buildGoal(self) -> Any:
        return AchieveGoal(
            author=manager_of(self.params["Robot"].value),
            goals=self.params["Goal"].value,
            priority=self.params["Priority"].value,
            max_replans=self.params["MaxReplans"].value,
        )

    def onFeedback(self, msg: Any) -> State:
        return self.step(f"{msg.phase}: {msg.message}")

    def onDone(self, status: int, msg: Any) -> State:
        text = msg.message if msg is not None else self.status_text()
        if status == GoalStatus.SUCCEEDED:
            return self.success(text)
        why = json.loads(getattr(msg, "explanations", "") or "[]")
        return self.fail(text, status, worst_kind(map(Explanation.from_dict, why)))
