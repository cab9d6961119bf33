"""Planning as a skill: plans for a goal and runs the plan."""

from __future__ import annotations

from typing import Any

import actionlib

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.manager_names import manager_of, same_node
from skiros2_common.core.params import ParamTypes
from skiros2_common.ros.connections import ServerWatch, send_goal
from skiros2_msgs.msg import AssignTaskAction, AssignTaskGoal
from skiros2_skill.core.processors import SerialStar
from skiros2_skill.core.skill import SkillBase
from skiros2_skill.ros.utils import deserialize_skill
from skiros2_task.ros.task_manager_interface import ACTION, NOTHING_TO_DO, PLAN

#: Timeout of a task manager that is missing or silent (s of wall time).
SERVER_TIMEOUT = 5.0


class TaskPlan(SkillDescription):
    """Plans for a goal and runs the skills of the plan."""

    def createDescription(self) -> None:
        self.addParam("Goal", str, ParamTypes.Required, description="PDDL goals, separated by commas")


class task_plan(SkillBase):
    """Requests a plan, adds its skills as children, and runs them in sequence.

    No hook blocks: other tasks continue during planning. Each start makes a new plan.
    """

    def createDescription(self) -> None:
        self.setDescription(TaskPlan(), self.__class__.__name__)
        self._expand_on_start = True
        self._client: Any = None
        self._watch: ServerWatch | None = None
        self._sent = False
        self._planned = False

    def expand(self, skill: Any) -> None:
        skill.setProcessor(SerialStar())

    def onStart(self) -> bool:
        if self._client is None:
            self._client = actionlib.SimpleActionClient(ACTION, AssignTaskAction)
        self._watch = ServerWatch(self._client)
        self._sent = self._planned = False
        return True

    def onPreempt(self) -> State:
        if self._sent and not self._planned:
            self._client.cancel_goal()
            self._client.stop_tracking_goal()
        return self.fail("Stopped", -1)

    def execute(self) -> State | None:
        if self._planned:
            return None  # the state of the children
        assert self._watch is not None
        if self._sent and self._client.gh.get_comm_state() == actionlib.CommState.DONE:
            return self._take(self._client.get_result())
        if self._sent and self._watch.time_without_result(self._client.gh) > SERVER_TIMEOUT:
            return self.fail(f"The plan of {self._watch.name} was lost", -103)
        if self._watch.time_since_status() > SERVER_TIMEOUT:
            return self.fail(f"No task manager answers on {self._watch.name}", -101)
        if not self._sent and self._watch.is_connected():
            self._sent = True
            # the task manager plans for the robot of the requesting manager
            send_goal(self._client, AssignTaskGoal(author=self._manager(), goals=self.params["Goal"].value))
        return self.step("Planning" if self._sent else "Waiting for the task manager")

    def _take(self, result: Any) -> State:
        """Processes the answer of the task manager."""
        if result.progress_code == NOTHING_TO_DO:
            return self.success("The goal is reached already")
        if result.progress_code != PLAN:
            return self.fail(f"No plan: {result.progress_message}", result.progress_code)
        try:
            steps = deserialize_skill(result.progress_message).children
            for step in steps:
                self._add(step)
        except SkirosError as error:
            return self.fail(f"The plan cannot be run: {error}", -102)
        self._planned = True
        return self.step(f"A plan of {len(steps)} skills: {', '.join(step.name for step in steps)}")

    def _add(self, step: Any) -> None:
        """Adds a step of the plan as a child.

        :raises WrongValue: it is for another robot.
        """
        manager = self._manager()
        if step.manager and not same_node(step.manager, manager):
            raise WrongValue(f"{step.name} is for {step.manager}, this is {manager}")
        node = self.skill(step.type, step.name)
        node.specifyParamsDefault(step.ph)
        self.addChild(node)

    def _manager(self) -> str:
        """The name of the manager that runs this skill."""
        return manager_of(self.params["Robot"].value)
