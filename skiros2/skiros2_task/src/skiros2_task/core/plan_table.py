"""A plan in time as rows of a table, for the command line and the window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_common.core.world_element import Element
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.plan import SkillCall
from skiros2_task.core.schedule import Schedule


@dataclass(frozen=True)
class PlanRow:
    """A step of a plan.

    :param number: from 1 on.
    :param start, end: s after the plan's start, as scheduled.
    :param robot: the node name of its manager.
    :param skill: the implementation, or the skill's class.
    :param after: the numbers of the steps that it waits for.
    :param parameters: in words, without the robot.
    """

    number: int
    start: float
    end: float
    robot: str
    skill: str
    after: tuple[int, ...]
    parameters: str


def plan_rows(schedule: Schedule, calls: Sequence[SkillCall]) -> list[PlanRow]:
    """The steps in the order of their starts.

    :param calls: one for each of the schedule's steps.
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
    """How many steps of how many robots, and how long they take."""
    robots = len({call.manager for call in calls})
    steps = f"{len(calls)} step{'s' * (len(calls) > 1)}"
    return f"{steps} of {robots} robot{'s' * (robots > 1)}, {schedule.makespan:.1f} s"


def _arguments(call: SkillCall) -> str:
    return ", ".join(f"{key}={_element(e)}" for key, e in call.arguments if key != ROBOT_KEY)


def _element(element: Element) -> str:
    return f'"{element.label}"' if element.label else element.id
