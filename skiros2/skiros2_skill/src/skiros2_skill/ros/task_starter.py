"""Creates tasks from the skills in a message."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError, WrongValue
from skiros2_common.core.explanation import START, Explanation
from skiros2_common.core.json_text import read_json
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.property import format_value
from skiros2_common.core.world_element import Element
from skiros2_common.ros import utils
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.history import REFUSED, History, Record, one_line
from skiros2_skill.core.runtime.request import JsonValues, SkillRequest, explain_refusal, make_nodes
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task

log = logging.getLogger(__name__)

#: The progress code of a refused task.
REFUSED_CODE = -1


class TaskRefused(Refused):
    """A task was refused; `record` has the reason."""

    def __init__(self, record: Record) -> None:
        super().__init__(record.message)
        self.record = record


class TaskStarter:
    """Creates the tasks of a manager. Any thread.

    :param library: the skill library; may be replaced later.
    :param robot: returns the robot's element, the value of `Robot` for skills without one.
    """

    def __init__(
        self, library: SkillLibrary, wmi: Any, scheduler: Scheduler, history: History, robot: Callable[[], Element]
    ) -> None:
        self.library = library
        self._wmi = wmi
        self._scheduler = scheduler
        self._history = history
        self._robot = robot

    def make(self, author: str, skills: Sequence[Any]) -> Task:
        """Creates a task that runs skills in sequence. The scheduler has it, not started.

        :param skills: `ResourceDescription` messages.
        :raises TaskRefused: the request is wrong; the history has the record.
        """
        explanation = None
        try:
            requests = [_request(skill) for skill in skills]
            self._wmi.catch_up()  # the client may have changed the world model just before
            try:
                return self._make(author, requests)
            except SkirosError:
                explanation = explain_refusal(requests, self.library, self._wmi, REFUSED_CODE)
                raise
        except SkirosError as error:
            text = str(error)
        except Exception as error:  # report internal errors to the client too
            log.exception("creating a task for %s", author or "unknown")
            text = f"internal error: {type(error).__name__}: {error}"
        text = one_line(text)
        if explanation is None:
            explanation = _explanation(skills, text)
        record = Record(REFUSED, author, State.Idle, REFUSED_CODE, text, [explanation])
        self._history.refuse(record)
        raise TaskRefused(record)

    def _make(self, author: str, requests: Sequence[SkillRequest]) -> Task:
        nodes = make_nodes(requests, self.library, self._wmi)
        robot = self._robot()
        task = self._scheduler.new_task(self._wmi, author)
        task.root.params.addParam("Robot", robot, ParamTypes.Inferred, "The manager's robot")
        task.root(*nodes)
        self._history.begin(task)
        return task


def _request(skill: Any) -> SkillRequest:
    """Converts a `ResourceDescription`. A parameter without `specType` and `type` gets them from the skill."""
    params: dict[str, Param | JsonValues] = {}
    problems: list[SkirosError] = []
    for index, message in enumerate(skill.params):
        try:
            key, param = _read(message.param)
        except SkirosError as error:
            problems.append(WrongValue(f"{skill.type}, params[{index}]: {error}"))
            continue
        if key in params:
            problems.append(WrongValue(f"{skill.type}: parameter {key!r} is given twice"))
        params[key] = param
    return SkillRequest(skill.type, skill.name, params, problems)


def _read(text: str) -> tuple[str, Param | JsonValues]:
    try:
        decoded = read_json(text)
    except ValueError as error:
        raise WrongValue(f"parameter is not JSON: {error}: {format_value(text)}") from None
    if not isinstance(decoded, dict) or not isinstance(decoded.get("key"), str):
        example = '{"key": "Duration", "values": [1.5]}'
        raise WrongValue(f"parameter: expected a JSON object such as {example}, got {format_value(text)}")
    if "specType" in decoded and "type" in decoded:
        param = utils.decodeParam(decoded)
        return param.key, param
    if "values" not in decoded:
        raise WrongValue(f'parameter {decoded["key"]!r} has no "values"')
    values = decoded["values"]
    return decoded["key"], JsonValues(values if isinstance(values, list) else [values])


def _explanation(skills: Sequence[Any], text: str) -> Explanation:
    if len(skills) == 1:
        return Explanation(START, skills[0].type, skills[0].name, -1, REFUSED_CODE, text)
    return Explanation(START, ":Root", "", -1, REFUSED_CODE, text)


def explanations_json(explanations: Iterable[Explanation]) -> str:
    """Encodes explanations as a JSON list."""
    return json.dumps([explanation.to_dict() for explanation in explanations])
