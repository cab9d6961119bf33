"""From the skills in a message to a task."""

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
from skiros2_skill.core.history import REFUSED, History, Record, one_line
from skiros2_skill.core.library import SkillLibrary
from skiros2_skill.core.request import Plain, SkillRequest, make_nodes, why_refused
from skiros2_skill.core.task import Task
from skiros2_skill.core.ticker import Ticker

log = logging.getLogger(__name__)

#: The progress code of a task that was refused.
REFUSED_CODE = -1


class TaskRefused(Refused):
    """A task that cannot be made. `record` tells why."""

    def __init__(self, record: Record) -> None:
        super().__init__(record.message)
        self.record = record


class TaskStarter:
    """Makes the tasks of a manager. Any thread.

    :param library: what the skills are taken from; another one may take its place.
    :param robot: called for the robot's element, which is `Robot` for skills that are given none.
    """

    def __init__(
        self, library: SkillLibrary, wmi: Any, ticker: Ticker, history: History, robot: Callable[[], Element]
    ) -> None:
        self.library = library
        self._wmi = wmi
        self._ticker = ticker
        self._history = history
        self._robot = robot

    def make(self, author: str, skills: Sequence[Any]) -> Task:
        """A task that runs these skills one after the other; the ticker has it, and it is not started.

        :param skills: as `ResourceDescription`.
        :raises TaskRefused: it cannot be made; this is kept in the history.
        """
        explanation = None
        try:
            requests = [_request(skill) for skill in skills]
            self._wmi.catch_up()  # the one who asks may just have changed the world that the request speaks of
            try:
                return self._make(author, requests)
            except SkirosError:
                explanation = why_refused(requests, self.library, self._wmi, REFUSED_CODE)
                raise
        except SkirosError as error:
            text = str(error)
        except Exception as error:  # a client has to hear of our own mistakes too
            log.exception("a task of %s", author or "somebody")
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
        task = self._ticker.new_task(self._wmi, author)
        task.root.params.addParam("Robot", robot, ParamTypes.Inferred, "The manager's robot")
        task.root(*nodes)
        self._history.begin(task)
        return task


def _request(skill: Any) -> SkillRequest:
    """What a `ResourceDescription` asks for. A parameter without `specType` and `type` takes them from the skill."""
    params: dict[str, Param | Plain] = {}
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


def _read(text: str) -> tuple[str, Param | Plain]:
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
    return decoded["key"], Plain(values if isinstance(values, list) else [values])


def _explanation(skills: Sequence[Any], text: str) -> Explanation:
    if len(skills) == 1:
        return Explanation(START, skills[0].type, skills[0].name, -1, REFUSED_CODE, text)
    return Explanation(START, ":Root", "", -1, REFUSED_CODE, text)


def explanations_json(explanations: Iterable[Explanation]) -> str:
    """Explanations as a JSON list."""
    return json.dumps([explanation.to_dict() for explanation in explanations])
