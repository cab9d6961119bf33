"""A robot and the executor of goals of a `LocalSystem`, as the commands use a skill manager and a task manager."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.command_line.command import UsageError
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.json_codec import param_texts
from skiros2_common.core.params import Param
from skiros2_local.progress import ParamText
from skiros2_local.system import LocalGoal, LocalRobot, LocalSystem, TaskRequest
from skiros2_runs.core.progress import NodeMessage
from skiros2_runs.core.states import FAILURE, SUCCESS
from skiros2_skill.client.description import Skill, Step, Why, read_skill
from skiros2_skill.core.runtime.diagnosis import add_authors
from skiros2_skill.core.runtime.history import REFUSED, Record
from skiros2_skill.core.runtime.request import SkillRequest, TaskRefused
from skiros2_skill.core.runtime.request_json import read_request
from skiros2_skill.core.start_preview import StartPreview
from skiros2_task.core.engines import Limits
from skiros2_task.core.goal_execution import Goal
from skiros2_task.core.goal_report import GoalProgress, GoalResult
from skiros2_task.core.planners import planner_named
from skiros2_world_model.core.local_world_model import LocalWorldModel


@dataclass(frozen=True)
class LocalFeedback:
    """The progress of a task; see `Feedback`."""

    task_id: int
    progress: Sequence[NodeMessage]


@dataclass(frozen=True)
class LocalResult:
    """The fields of an `ExecuteSkillsResult`, but for the explanations."""

    task_id: int
    state: int
    code: int
    message: str
    params: list[ParamText]


class LocalRun:
    """A task that was requested; see `RunPort`.

    :param robot: runs it.
    """

    def __init__(self, robot: LocalRobot) -> None:
        self._robot = robot
        self._ended = threading.Event()
        self._record = Record(REFUSED, "", State.Idle, -1, "")
        self._outputs: dict[str, Param] = {}
        #: The id of the task; -1 when it was refused.
        self.task = REFUSED

    def end(self, record: Record, outputs: dict[str, Param]) -> None:
        """Called once, at the end."""
        self._record, self._outputs = record, outputs
        self._ended.set()

    def wait(self, timeout: float | None = None) -> bool:
        """Waits for the end, at most `timeout` s. Returns whether it has ended or was refused."""
        return self._ended.wait(timeout)

    def cancel(self) -> None:
        """Preempts the task. Returns at once."""
        self._robot.stop(self.task)

    def result(self) -> LocalResult:
        """Waits for the end. Returns the result."""
        self.wait()
        record = self._record
        state = SUCCESS if record.state is State.Success else FAILURE
        params = [ParamText(text) for text in param_texts(self._outputs)]
        return LocalResult(record.task_id, state, record.code, record.message, params)

    def succeeded(self) -> bool:
        """Waits for the end. Returns whether the task has succeeded."""
        self.wait()
        return self._record.state is State.Success

    def explanations(self) -> list[Explanation]:
        """Waits for the end. Returns why nodes failed, the last failure at the end."""
        self.wait()
        return self._record.explanations


class LocalManager:
    """The manager of a robot in this process; see `ManagerPort`.

    :param author: named in the records of tasks.
    :param world_model: of the author.
    """

    def __init__(self, robot: LocalRobot, author: str, world_model: LocalWorldModel) -> None:
        self._robot = robot
        self.name = robot.name
        self.author = author
        self.world_model = world_model

    def read_skills(self) -> list[Skill]:
        """Returns the offered skills."""
        return [
            read_skill(i.type, i.label, param_texts(i.declared.params.getParamMap()))
            for i in self._robot.library.implementations()
        ]

    def command(self, action: str, task_id: int, skills: Sequence[Step] = ()) -> int:
        """Refuses: without ROS a task ends with its command."""
        raise UsageError("a task ends with its command; to detach from a task needs ROS")

    def preview(self, skills: Sequence[Step]) -> StartPreview:
        """Returns what a start of skills in sequence would do now; changes nothing."""
        return self._robot.starter.preview(_requests(skills))

    def run(self, skills: Sequence[Step], monitor_cb: Callable[[Any], None]) -> LocalRun:
        """Runs skills in sequence as a new task.

        :param monitor_cb: called with each `LocalFeedback`, in another thread.
        """
        run = LocalRun(self._robot)

        def report(nodes: Sequence[NodeMessage]) -> None:
            monitor_cb(LocalFeedback(nodes[0].task_id, nodes))

        try:
            run.task = self._robot.start_task(TaskRequest(_requests(skills), self.author, run.end, report))
        except TaskRefused as refused:
            run.end(refused.record, {})
        return run

    def why(self, task_id: int = -1) -> Why:
        """Returns why a task or its nodes failed; -1: the last task that failed or was refused."""
        record = self._robot.why(task_id)
        add_authors(record.explanations, self.world_model)
        return Why(str(record), record.explanations)

    def safety(self) -> Any:
        """Refuses: stops come from topics."""
        raise Refused("without ROS nothing stops the robot")


def _requests(skills: Sequence[Step]) -> list[SkillRequest]:
    return [read_request(skill.type, skill.label, skill.params) for skill in skills]


class LocalGoalClient:
    """Achieves one goal; see `GoalClient`."""

    def __init__(self, system: LocalSystem) -> None:
        self._system = system
        self._goal = LocalGoal()

    def achieve(
        self,
        goals: str,
        *,
        feedback_cb: Callable[[GoalProgress], None],
        quality: str,
        seconds: float,
        priority: int,
        max_replans: int,
    ) -> None:
        """Starts; see `TaskManagerInterface.achieve`."""

        def report(goal: LocalGoal) -> None:
            if goal.progress is not None:
                feedback_cb(goal.progress)

        goal = Goal(
            goals,
            priority,
            Limits(seconds) if seconds else None,
            planner_named(self._system.processes, quality) if quality else None,
            max_replans if max_replans >= 0 else Goal.max_replans,
        )
        self._goal = self._system.achieve(goal, report)

    def wait_for_result(self) -> GoalResult:
        """Waits for the end. Returns the result."""
        result = self._goal.wait().result
        assert result is not None
        return result

    def preempt(self) -> None:
        """Cancels the goal."""
        self._goal.cancel()
