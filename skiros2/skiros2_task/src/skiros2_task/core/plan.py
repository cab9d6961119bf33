"""Plans as skill calls, and as rows of a table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.schedule import Schedule
from skiros2_task.core.skills import SkillParameter
from skiros2_task.core.task import PlanningTask, PlanStep


@dataclass(frozen=True)
class SkillCall:
    """A skill to run, with the elements of its parameters.

    :param manager: the node name of the skill manager, such as `/test_robot`.
    :param type: the skill's class.
    :param label: the implementation.
    :param arguments: (parameter, element) pairs. An abstract element stands for any element of its class and label.
    :param parameters: the skill's element parameters.
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
    """Returns the calls that execute a plan, in its order.

    :param objects: the elements of the task's objects. An element without id and label, which a skill has yet to
        create, is not an argument: the skill infers it when it starts.
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


@dataclass(frozen=True)
class PlanRow:
    """A step of a plan.

    :param number: counts from 1.
    :param start, end: scheduled times (s after the plan's start).
    :param robot: the node name of the skill manager.
    :param skill: the implementation, or the skill's class.
    :param after: the numbers of the direct predecessors.
    :param parameters: as text, without the robot.
    """

    number: int
    start: float
    end: float
    robot: str
    skill: str
    after: tuple[int, ...]
    parameters: str


def plan_rows(schedule: Schedule, calls: Sequence[SkillCall]) -> list[PlanRow]:
    """Returns the steps in the order of their starts.

    :param calls: one for each step of the schedule.
    """
    before = schedule.order.predecessors()
    return [
        PlanRow(
            step.step + 1,
            step.start,
            step.end,
            calls[step.step].manager,
            calls[step.step].label or calls[step.step].type,
            tuple(i + 1 for i in before[step.step]),
            _arguments(calls[step.step]),
        )
        for step in sorted(schedule.steps, key=lambda s: (s.start, s.step))
    ]


def plan_head(schedule: Schedule, calls: Sequence[SkillCall]) -> str:
    """Returns the numbers of steps and robots, and the makespan, as text."""
    robots = len({call.manager for call in calls})
    steps = f"{len(calls)} step{'s' * (len(calls) > 1)}"
    return f"{steps} of {robots} robot{'s' * (robots > 1)}, {schedule.makespan:.1f} s"


def _arguments(call: SkillCall) -> str:
    return ", ".join(f"{key}={_element(e)}" for key, e in call.arguments if key != ROBOT_KEY)


def _element(element: Element) -> str:
    return f'"{element.label}"' if element.label else element.id
