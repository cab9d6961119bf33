"""From the steps of a plan to what a skill manager runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from skiros2_common.core.world_element import Element
from skiros2_task.core.skill_model import SkillParameter
from skiros2_task.core.task import PlanningTask, PlanStep


@dataclass(frozen=True)
class SkillCall:
    """A skill to be run with these elements in its parameters.

    :param manager: the node name of the skill manager, such as `/test_robot`.
    :param type: the skill's class.
    :param label: the implementation.
    :param arguments: (parameter, element) pairs. An abstract element stands for any of its class and label.
    :param parameters: those of the skill that hold elements.
    """

    manager: str
    type: str
    label: str
    arguments: tuple[tuple[str, Element], ...]
    parameters: tuple[SkillParameter, ...] = ()

    def __str__(self) -> str:
        shown = ", ".join(f"{key}={e.id or e.label or e.type}" for key, e in self.arguments)
        return f"{self.type} ({self.label}) by {self.manager}: {shown}"


def skill_calls(task: PlanningTask, plan: Iterable[PlanStep], objects: Mapping[str, Element]) -> tuple[SkillCall, ...]:
    """The calls that carry out a plan, in its order.

    :param objects: the elements behind the task's objects. What a skill is still to make has neither id nor label, and
        is left for the skills to find when they run.
    """
    return tuple(_call(task, step, objects) for step in plan)


def _call(task: PlanningTask, step: PlanStep, objects: Mapping[str, Element]) -> SkillCall:
    action = task.action(step.action)
    values = {v.name: name for v, name in zip(action.variables, step.arguments, strict=True)}
    arguments = tuple(
        (v.key, objects[values[v.name]])
        for v in action.variables
        if v.key and (objects[values[v.name]].id or objects[values[v.name]].label)
    )
    manager = dict(action.managers)[values[action.robot]]
    parameters = tuple(p for p in action.skill.parameters if p.element_class is not None)
    return SkillCall(manager, action.skill.type, action.skill.label, arguments, parameters)
