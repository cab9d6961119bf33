"""When each step of a plan is done, and by which robot."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.durations import Durations
from skiros2_task.core.partial_order import PartialOrder, deorder
from skiros2_task.core.reassignment import reassigned
from skiros2_task.core.reduction import reduced
from skiros2_task.core.task import PlanningTask, PlanStep, robot_of

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Scheduled:
    """When a step is done.

    :param step: its index in the order's steps.
    :param robot: that does it.
    :param start, end: s after the plan's start.
    """

    step: int
    robot: str
    start: float
    end: float


@dataclass(frozen=True)
class Schedule:
    """A plan in time.

    :param order: the steps, and what is needed of their order.
    :param steps: when each is done, as in the order's steps.
    :param makespan: s from the first start to the last end.
    """

    order: PartialOrder
    steps: tuple[Scheduled, ...]
    makespan: float


def schedule_plan(task: PlanningTask, plan: Sequence[PlanStep], durations: Durations) -> Schedule:
    """The schedule of a plan without its redundant steps.

    :param plan: steps that work in this order; see `simulation.flaw`.
    :raises WrongValue: they do not.
    """
    return schedule(task, deorder(task, reduced(task, plan)), durations)


def schedule(task: PlanningTask, order: PartialOrder, durations: Durations) -> Schedule:
    """The schedule of a plan: each step as early as the order lets it.

    Steps are given to other robots that have the skill, in another order, where that shortens the plan and it still
    works.
    """
    as_planned = _as_early_as_possible(task, order, durations)
    plan = reassigned(task, order, durations)
    if plan is None:
        return as_planned
    try:
        other = deorder(task, plan)
    except WrongValue as reason:
        log.debug("dealing out the steps anew is of no use: %s", reason)
        return as_planned
    dealt_out = _as_early_as_possible(task, other, durations)
    return dealt_out if dealt_out.makespan < as_planned.makespan else as_planned


def _as_early_as_possible(task: PlanningTask, order: PartialOrder, durations: Durations) -> Schedule:
    steps: list[Scheduled] = []
    for index, (step, before) in enumerate(zip(order.steps, order.predecessors(), strict=True)):
        start = max((steps[i].end for i in before), default=0.0)
        end = start + seconds_of(task, step, durations)
        steps.append(Scheduled(index, robot_of(task, step), start, end))
    return Schedule(order, tuple(steps), max((s.end for s in steps), default=0.0))


def seconds_of(task: PlanningTask, step: PlanStep, durations: Durations) -> float:
    """How long a step is expected to take."""
    action = task.action(step.action)
    return durations.seconds(action.skill, dict(action.managers).get(robot_of(task, step), ""))
