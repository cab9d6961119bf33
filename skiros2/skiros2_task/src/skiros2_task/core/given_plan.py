"""A plan that was made before, such as one that a person has approved: it is executed as it is, or refused."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.world_element import Element
from skiros2_task.core.partial_order import PartialOrder, deorder
from skiros2_task.core.plan import Plan, Step, plan_of
from skiros2_task.core.schedule import as_early_as_possible
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep, validate

#: The fields of a step that say what runs.
_CALL = ("skill", "label", "robot", "arguments")


@dataclass(frozen=True)
class GivenPlan:
    """A plan as JSON data; see `plan_data`.

    :param steps: with the fields `action` (a name and its arguments), `after`, and those of `_CALL`.
    """

    steps: tuple[Mapping[str, Any], ...]

    def plan(self, task: PlanningTask, durations: Durations, objects: Mapping[str, Element]) -> Plan:
        """Returns the plan for a task, with the same steps, robots and order.

        :param durations: of the skills.
        :param objects: see `skiros2_task.core.plan.make_plan`.
        :raises WrongValue: it does not lead to the goal, or its steps would be others. The text says what has changed.
        """
        steps = tuple(PlanStep(step["action"][0], tuple(step["action"][1:])) for step in self.steps)
        if reason := validate(task, steps):
            raise WrongValue(f"the given plan no longer works: {reason}")
        needed = deorder(task, steps)
        before = frozenset((first - 1, i) for i, step in enumerate(self.steps) for first in step["after"])
        if missing := sorted(needed.before - _closure(before)):
            first, second = missing[0][0] + 1, missing[0][1] + 1
            raise WrongValue(f"the given plan no longer works: step {second} would have to wait for {first}")
        order = PartialOrder(steps, before, needed.links)
        plan = plan_of(task, as_early_as_possible(task, order, durations), objects)
        for step, given in zip(plan.steps, self.steps, strict=True):
            _check_same(step, given)
        return plan


def plan_data(plan: Plan) -> list[dict[str, Any]]:
    """Returns a plan as JSON data: its steps as in the feedback of `Achieve`, and the `action` of each."""
    planned = zip(plan.steps, plan.order.steps, strict=True)
    return [{**step.to_dict(), "action": [action.action, *action.arguments]} for step, action in planned]


def is_given_plan(text: str) -> bool:
    """Whether a text is to be read as a given plan, and not as a plan quality."""
    return text.lstrip().startswith("[")


def read_given_plan(text: str) -> GivenPlan:
    """Reads the JSON text of `plan_data`.

    :raises WrongValue: the text has no such plan.
    """
    try:
        data = read_json(text)
    except ValueError as error:
        raise WrongValue(f"the given plan is not JSON: {error}") from None
    for number, step in enumerate(data if isinstance(data, list) else [None], 1):
        if not isinstance(step, dict) or not _is_step(step, number):
            raise WrongValue(f"step {number} of the given plan is {json.dumps(step)[:200]}, expected one of MakePlan")
    return GivenPlan(tuple(data))


def _is_step(step: Mapping[str, Any], number: int) -> bool:
    action, after = step.get("action"), step.get("after")
    return (
        all(key in step for key in _CALL)
        and isinstance(action, list)
        and len(action) > 0
        and all(isinstance(part, str) for part in action)
        and step.get("number") == number
        and isinstance(after, list)
        and all(type(first) is int and 0 < first < number for first in after)
    )


def _closure(before: frozenset[tuple[int, int]]) -> frozenset[tuple[int, int]]:
    """Returns the ordered pairs and those that follow from them; the first of a pair is the smaller."""
    earlier: dict[int, set[int]] = {}
    for first, second in sorted(before, key=lambda pair: pair[1]):
        earlier.setdefault(second, set()).update({first}, earlier.get(first, ()))
    return frozenset((first, second) for second, found in earlier.items() for first in found)


def _check_same(step: Step, given: Mapping[str, Any]) -> None:
    """
    :raises WrongValue: the step would run something else.
    """
    now = step.to_dict()
    for key in _CALL:
        if now[key] != given[key]:
            raise WrongValue(f"{step} has another {key} than the given plan: {now[key]}, expected {given[key]}")
