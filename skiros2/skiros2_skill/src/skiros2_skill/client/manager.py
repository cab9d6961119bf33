"""The client of one skill manager: its services, and its action `execute`, each goal of which is a task."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.world_element import Element
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_runs.core.values import NodeStatus, TaskBounds
from skiros2_skill.client.description import Skill, Step, Why, read_skill
from skiros2_skill.client.port import ALL, ENDED, NEW
from skiros2_skill.client.skill_goal import SkillGoal, SkillRunner
from skiros2_skill.client.stop_line import NoStopService, StopLine
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.start_preview import StartPreview
from skiros2_skill.ros.utils import SkillHolder
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)

__all__ = ["ALL", "ENDED", "NEW", "ManagerClient"]

#: The services of a manager, private names of its node.
_SERVICES = {
    "get_skills": srvs.ResourceGetDescriptions,
    "command": srvs.SkillCommand,
    "tasks": srvs.SkillTasks,
    "why": srvs.SkillWhy,
    "inspect": srvs.SkillInspection,
    "preview": srvs.SkillPreview,
    "breakpoint": srvs.SkillBreakpoint,
    "reload": srvs.SkillReload,
    "safety": srvs.SkillSafety,
}


class ManagerClient:
    """Calls a manager's services. Any thread; needs a node only for `run`.

    Each call blocks until the manager answers, and raises `SkirosError` when it refuses or does not answer.

    :param name: the manager's node name.
    :param author: named in the manager's log.
    """

    #: See `ManagerPort`.
    world_model = None

    def __init__(self, name: str, author: str) -> None:
        self._name = name
        self.author = author
        self._services = {key: ServicePool(f"{name}/{key}", kind, 0.0) for key, kind in _SERVICES.items()}
        #: Preempts, pauses and resumes tasks; nothing else uses its connections.
        self.stop_line = StopLine(name)
        self._runner: SkillRunner | None = None
        self._runner_lock = threading.Lock()

    @property
    def name(self) -> str:
        """The manager's node name."""
        return self._name

    def close(self) -> None:
        """Closes all connections."""
        for service in self._services.values():
            service.close()
        self.stop_line.close()
        with self._runner_lock:
            runner, self._runner = self._runner, None
        if runner is not None:
            runner.close()

    # -- skills ------------------------------------------------------------------------------------------------

    def descriptions(self) -> list[Any]:
        """Returns the offered skills as `ResourceDescription`s. Waits until the manager has loaded them."""
        return list(self._call("get_skills", srvs.ResourceGetDescriptionsRequest()).list)

    def read_skills(self) -> list[Skill]:
        """Returns the offered skills as plain data. Waits until the manager has loaded them."""
        return [read_skill(s.type, s.name, [p.param for p in s.params]) for s in self.descriptions()]

    def reload(self, libraries: Sequence[str] = ()) -> str:
        """Reloads libraries; none: all. Returns the manager's message.

        :raises Refused: the reload has failed, and nothing has changed.
        """
        answer = self._call("reload", srvs.SkillReloadRequest(list(libraries)), repeatable=False)
        if not answer.ok:
            raise Refused(f"{self.name}: {answer.text}")
        return str(answer.text)

    # -- tasks -------------------------------------------------------------------------------------------------

    def command(self, action: str, task_id: int, skills: Sequence[Step | SkillHolder] = ()) -> int:
        """Sends a command; see `SkillCommand`. Returns the task id.

        :param action: `start` (with `NEW` starts a task, else resumes a paused one), `preempt`, `pause` (with `ALL` of
            all tasks) or `tick_once` (with `NEW` starts a task, ticks it once and pauses it).
        :param skills: of a new task, in sequence.
        :raises TimedOut: a task was not preempted, paused or resumed within 3 s, and will not be later.
        """
        kind = srvs.SkillCommandRequest
        if action in (kind.PREEMPT, kind.PAUSE) or (action == kind.START and task_id != NEW):
            try:
                self.stop_line.send(self.author, action, task_id)
            except NoStopService:  # of an earlier version
                log.debug("%s has no service stop", self.name)
            else:
                return task_id
        request = kind(self.author, action, task_id, [_message(skill) for skill in skills])
        return int(self._call("command", request, repeatable=False).execution_id)

    def preview(self, skills: Sequence[Step | SkillHolder], partial: bool = False) -> StartPreview:
        """Returns what a start of skills in sequence would do now; changes nothing.

        :param partial: whether required parameters may have no value yet.
        """
        answer = self._call("preview", srvs.SkillPreviewRequest([_message(skill) for skill in skills], partial))
        if not answer.ok:
            return StartPreview(refusal=Explanation.from_dict(json.loads(answer.explanation)))
        found = utils.deserializeParamMap(answer.params)
        elements = {key: param.value for key, param in found.items() if isinstance(param.value, Element)}
        values = {key: [elements[key].id] if key in elements else param.values for key, param in found.items()}
        return StartPreview(answer.label, elements, values)

    def run(
        self,
        skills: Sequence[Step | SkillHolder],
        monitor_cb: Callable[[Any], None] | None = None,
        goal_id: str = "",
        goal: str = "",
    ) -> SkillGoal:
        """Runs skills in sequence as a new task. Returns a handle to wait for or cancel it.

        :param monitor_cb: called, in a thread of ROS, with each `ExecuteSkillsFeedback`.
        :param goal_id: with which another process can `attach` to the task; "": a new one.
        :param goal: of the task manager, of which the skills are a step; "": none.
        :raises TimedOut: the manager does not answer within 5 s.
        """
        messages = [_message(skill) for skill in skills]
        return self._action.run(self.author, messages, monitor_cb, goal_id=goal_id, goal=goal)

    def attach(self, goal_id: str) -> SkillGoal:
        """Follows a task that another process has started; see `SkillGoal.wait_until_known`.

        :raises TimedOut: the manager does not answer within 5 s.
        """
        return self._action.attach(self.author, goal_id)

    @property
    def _action(self) -> SkillRunner:
        with self._runner_lock:
            if self._runner is None:
                self._runner = SkillRunner(self.name)
            return self._runner

    def read_tasks(self, task_id: int = ALL) -> list[Sequence[Any]]:
        """Returns the tasks that have not ended, by id: the `SkillProgress` of each node, parents before children.

        :param task_id: of one task, `ALL`, or `ENDED`: instead of these, the last ones that have ended.
        """
        trees = self._call("tasks", srvs.SkillTasksRequest(task_id)).tasks
        return sorted((tree.progress for tree in trees), key=lambda nodes: nodes[0].id)

    # -- diagnosis ---------------------------------------------------------------------------------------------

    def why(self, task_id: int = -1) -> Why:
        """Returns why a task or its nodes failed.

        :param task_id: -1: the last task that failed or was refused.
        :raises UnknownName: the manager knows no such task.
        """
        answer = self._known(self._call("why", srvs.SkillWhyRequest(task_id)))
        return Why(answer.text, [Explanation.from_dict(data) for data in json.loads(answer.json or "[]")])

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        """Inspects a node of a task that has not ended: its parameters, and whether its conditions hold.

        :param node_id: from `SkillProgress`.
        :raises UnknownName: the manager knows no such task or node.
        """
        answer = self._known(self._call("inspect", srvs.SkillInspectionRequest(task_id, node_id)))
        return NodeStatus.from_json(answer.json)

    def signal_bounds(self, task_id: int) -> TaskBounds:
        """Returns the limits that the nodes of a task have set for signals in their last runs.

        :raises UnknownName: the manager knows no such task.
        """
        answer = self._known(self._call("inspect", srvs.SkillInspectionRequest(task_id, ALL)))
        return TaskBounds.from_json(answer.json)

    def _known(self, answer: Any) -> Any:
        if not answer.ok:
            raise UnknownName(f"{self.name}: {answer.text}")
        return answer

    def safety(self) -> Any:
        """Returns the `SafetyStatus` of the robot."""
        return self._call("safety", srvs.SkillSafetyRequest()).safety

    # -- breakpoints -------------------------------------------------------------------------------------------

    def set_breakpoint(self, kind: str, pattern: str, when: str = "") -> int:
        """Adds a breakpoint; see `skiros2_skill.core.engine.breakpoints.Breakpoint`. Returns its number."""
        request = srvs.SkillBreakpointRequest(srvs.SkillBreakpointRequest.ADD, kind, pattern, when, 0)
        return int(self._call("breakpoint", request, repeatable=False).number)

    def remove_breakpoint(self, number: int = ALL) -> None:
        """Removes a breakpoint, or all."""
        request = srvs.SkillBreakpointRequest(action=srvs.SkillBreakpointRequest.REMOVE, number=number)
        self._call("breakpoint", request, repeatable=False)

    def breakpoints(self) -> dict[int, Breakpoint]:
        """Returns the breakpoints by number."""
        answer = self._call("breakpoint", srvs.SkillBreakpointRequest(action=srvs.SkillBreakpointRequest.LIST))
        return {b["number"]: Breakpoint(b["kind"], b["pattern"], b["when"]) for b in json.loads(answer.json)}

    def _call(self, service: str, request: Any, repeatable: bool = True) -> Any:
        """Calls a service. Raises `WmException` when the manager refuses, or does not answer."""
        return self._services[service].call(request, repeatable)


def _message(skill: Step | SkillHolder) -> Any:
    if isinstance(skill, SkillHolder):
        return skill.toMsg()
    return msgs.ResourceDescription(skill.type, skill.label, [msgs.Param(p) for p in skill.params])
