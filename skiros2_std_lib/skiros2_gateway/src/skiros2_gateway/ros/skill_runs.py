"""Checks and starts single skills, with values as an agent gives them, and keeps their results."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from skiros2_common.core.errors import Refused, TimedOut, UnknownName
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.wording import visible
from skiros2_common.core.world_element import Element
from skiros2_gateway.core.deadline import remaining
from skiros2_msgs.msg import SkillProgress
from skiros2_skill.client.description import Step
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.client.skill_goal import SkillGoal
from skiros2_skill.command_line.assignments import read_steps
from skiros2_skill.command_line.queries import World
from skiros2_skill.core.start_preview import StartPreview
from skiros2_task.core.preview import change_sentences, preview_skill
from skiros2_task.core.skills import read_robots
from skiros2_world_model.core.preview_copy import PreviewCopy
from skiros2_world_model.core.world_model_client import WorldModelClient

#: How many of the newest runs are kept.
_MAX_RUNS = 200
#: A start that is not accepted this long before its deadline is cancelled (s).
_MARGIN = 0.5


@dataclass(frozen=True)
class _Started:
    skill: str
    parameters: Mapping[str, Any]
    run: SkillGoal


class SkillRuns:
    """The skills that were started. Its methods block; any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._runs: dict[tuple[str, int], _Started] = {}

    def start(
        self,
        client: ManagerClient,
        wm: WorldModelClient,
        skill: str,
        parameters: Mapping[str, Any],
        values: Mapping[str, Any],
    ) -> int:
        """Starts a skill. Returns the number of its task.

        :param skill, parameters, values: see `Cell.run_skill`.
        :raises Refused: the manager refuses it.
        :raises SkirosError: skill or parameters are wrong, or the manager does not answer.
        """
        run = client.run(_steps(client, wm, skill, values))
        limit = remaining()
        task = run.wait_for_task(max(0.0, limit - _MARGIN) if limit < math.inf else None)
        if task < 0 and not run.done:
            run.cancel()  # it is not to start after the caller was told that it has failed
            raise TimedOut(f"{client.name} has not started {skill} in time, and does not start it later")
        if task < 0:
            raise Refused(f"{client.name} does not start {skill}: {run.result().message}")
        with self._lock:
            self._runs[client.name, task] = _Started(skill, parameters, run)
            while len(self._runs) > _MAX_RUNS:
                del self._runs[next(iter(self._runs))]
        return task

    def describe(self, robot: str, task: int) -> dict[str, Any]:
        """Returns a started skill: see `Cell.skill_run`.

        :raises UnknownName: it was not started here, or newer ones have replaced it.
        :raises TimedOut: its manager has died.
        """
        with self._lock:
            started = self._runs.get((matching_name(robot, [name for name, _ in self._runs]), task))
            known = ", ".join(f"{name} {number}" for name, number in self._runs) or "none"
        if started is None:
            raise UnknownName(f"no task {task} of {robot} was started by an agent; there are: {known}")
        found = {"skill": started.skill, "parameters": dict(started.parameters)}
        if not started.run.wait(0.0):
            return {**found, "state": "running", "message": "", "explanations": []}
        result = started.run.result()
        state = "succeeded" if result.state == SkillProgress.SUCCESS else "failed"
        why = json.loads(result.explanation or "[]")
        return {**found, "state": state, "message": result.message, "explanations": why}


def check_start(
    client: ManagerClient, wm: WorldModelClient, skill: str, parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Returns what a start would do now, as of `Cell.check_start`; blocks.

    :param skill: type, or label of an implementation.
    :param parameters: values by key; elements by id or label.
    :raises SkirosError: skill or parameters are wrong, or the manager does not answer.
    """
    preview = client.preview(_steps(client, wm, skill, parameters))
    return {
        "ok": preview.refusal is None,
        "implementation": preview.label,
        "elements": {key: element.id for key, element in preview.elements.items()},
        "values": {key: _argument(values) for key, values in sorted(preview.values.items())},
        "changes": expected_changes(client.name, wm, preview) if preview.refusal is None else [],
        "why": preview.refusal.to_dict() if preview.refusal is not None else None,
    }


def _steps(client: ManagerClient, wm: WorldModelClient, skill: str, parameters: Mapping[str, Any]) -> list[Step]:
    words = [skill, *(f"{key}={_text(value)}" for key, value in parameters.items())]
    world = World(client.name, client.author, wm)
    return read_steps(words, client.read_skills(), world.find_element, world.has_learned_values)


def expected_changes(manager: str, wm: WorldModelClient, preview: StartPreview) -> list[str]:
    """Returns the changes that a start is expected to make, a line each; blocks.

    An element that it makes has the name `new CLASS NUMBER`: which id it gets is open.
    """
    elements = {element.id: element for element in wm.resolve_elements(Element())}
    robots = read_robots(elements, lambda _: {manager: ""})
    skills = [skill for robot in robots if robot.manager == manager for skill in robot.skills]
    skill = next((skill for skill in skills if skill.label == preview.label), None)
    if skill is None:
        return ["unknown: the skill is not in the world model"]
    first = {key: values[0] for key, values in preview.values.items() if values}
    ids = {key: value for key, value in first.items() if isinstance(value, str) and value in elements}
    copy = PreviewCopy(wm)
    expected = preview_skill(copy, skill, manager, ids)
    made = [element for element in copy.resolve_elements(Element()) if element.id not in elements]
    new = {element.id: f"new {element.type} {number}" for number, element in enumerate(made, 1)}
    changes = [change for step in expected.steps for change in step.changes]
    named = [replace(c, element=new.get(c.element, c.element), value=new.get(c.value, c.value)) for c in changes]
    return [visible(text) for text in change_sentences(named, str)]


def _argument(values: list[Any]) -> Any:
    """Returns values of a parameter such that `read_steps` reads them again."""
    is_plain = len(values) == 1 and not (isinstance(values[0], str) and values[0].startswith("["))
    return values[0] if is_plain else values


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
