"""The diagnosis services of a manager: `~tasks`, `~why`, `~inspect`, `~preview` and `~breakpoint`."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.core.diagnosis import add_authors, inspect
from skiros2_skill.core.engine.breakpoints import Breakpoint
from skiros2_skill.core.runtime.history import History
from skiros2_skill.core.runtime.request import TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.messages import explanations_json, param_messages, skill_request, wire_text

log = logging.getLogger(__name__)

_ALL = -1


class Diagnosis:
    """Offers the services until `close`.

    :param progress: returns the `SkillProgress` of each node of a task.
    :param wmi: evaluates conditions, and has the authors of changes.
    """

    def __init__(
        self,
        history: History,
        scheduler: Scheduler,
        starter: TaskStarter,
        progress: Callable[[Task], list[Any]],
        wmi: WorldModelPort,
    ) -> None:
        self._history = history
        self._scheduler = scheduler
        self._starter = starter
        self._progress = progress
        self._wmi = wmi
        self._breakpoints = scheduler.breakpoints
        self._services = [
            rospy.Service("~tasks", srvs.SkillTasks, self._on_tasks),
            rospy.Service("~why", srvs.SkillWhy, self._on_why),
            rospy.Service("~inspect", srvs.SkillInspection, self._on_inspect),
            rospy.Service("~preview", srvs.SkillPreview, self._on_preview),
            rospy.Service("~breakpoint", srvs.SkillBreakpoint, self._on_breakpoint),
        ]

    def close(self) -> None:
        for service in self._services:
            service.shutdown()

    def _on_tasks(self, request: Any) -> Any:
        tasks = [task for task in self._scheduler.tasks() if request.task_id in (_ALL, task.id)]
        return srvs.SkillTasksResponse([msgs.TreeProgress(self._progress(task)) for task in tasks])

    def _on_why(self, request: Any) -> Any:
        try:
            record = self._history.get(request.task_id)
        except UnknownName as error:
            return srvs.SkillWhyResponse(False, str(error), "[]")
        add_authors(record.explanations, self._wmi)
        return srvs.SkillWhyResponse(True, wire_text(str(record)), explanations_json(record.explanations))

    def _on_inspect(self, request: Any) -> Any:
        try:
            status = inspect(self._history.task(request.task_id), request.node_id, self._wmi)
        except UnknownName as error:
            return srvs.SkillInspectionResponse(False, str(error), "")
        return srvs.SkillInspectionResponse(True, "", json.dumps(status.to_dict()))

    def _on_preview(self, request: Any) -> Any:
        try:
            preview = self._starter.preview([skill_request(skill) for skill in request.skills], request.partial)
        except SkirosError as error:
            raise rospy.ServiceException(str(error)) from error
        if preview.refusal is not None:
            return srvs.SkillPreviewResponse(False, "", [], json.dumps(preview.refusal.to_dict()))
        params = {key: Param(key, "", element, ParamTypes.Inferred) for key, element in preview.elements.items()}
        return srvs.SkillPreviewResponse(True, preview.label, param_messages(params), "")

    def _on_breakpoint(self, request: Any) -> Any:
        commands = {request.ADD: self._add, request.REMOVE: self._remove, request.LIST: lambda _: 0}
        try:
            if request.action not in commands:
                raise UnknownName(f"unknown action {request.action!r}, expected one of: {', '.join(commands)}")
            number = commands[request.action](request)
        except SkirosError as error:
            log.warning("breakpoint: %s refused: %s", request.action, error)
            raise rospy.ServiceException(f"{request.action} refused: {error}") from error
        known = [
            {"number": n, "kind": b.kind, "pattern": b.pattern, "when": b.when}
            for n, b in self._breakpoints.all().items()
        ]
        return srvs.SkillBreakpointResponse(True, number, json.dumps(known))

    def _add(self, request: Any) -> int:
        breakpoint = Breakpoint(request.kind, request.pattern, request.when)
        number = self._breakpoints.add(breakpoint)
        log.info("breakpoint %s: %s", number, breakpoint)
        return number

    def _remove(self, request: Any) -> int:
        numbers = self._breakpoints.all() if request.number == _ALL else [request.number]
        for number in numbers:
            self._breakpoints.remove(number)
        return int(request.number)
