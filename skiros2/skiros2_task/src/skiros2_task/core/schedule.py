"""Schedules: the robot, start and end of each step of a plan."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.partial_order import PartialOrder, deorder
from skiros2_task.core.robot_assignment import RobotAssigner
from skiros2_task.core.store import Durations
from skiros2_task.core.task import PlanningTask, PlanStep

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Scheduled:
    """A scheduled step.

    :param step: its index in the order's steps.
    :param robot: the id of the robot that executes it.
    :param start, end: s after the plan's start.
    """

    step: int
    robot: str
    start: float
    end: float


@dataclass(frozen=True)
class Schedule:
    """A scheduled plan.

    :param steps: in the sequence of the order's steps.
    :param makespan: s from the first start to the last end.
    :param bound: no schedule of the plan's parts is shorter (s); 0: not known. See `makespan_bound`.
    """

    order: PartialOrder
    steps: tuple[Scheduled, ...]
    makespan: float
    bound: float = 0.0


def schedule(task: PlanningTask, order: PartialOrder, durations: Durations) -> Schedule:
    """The schedule of a plan: each step as early as the order lets it.

    Steps are given to other robots that have the skill, in another order, where that shortens the plan and it still
    works.
    """
    as_planned = as_early_as_possible(task, order, durations)
    assigner = RobotAssigner(task, order, durations)
    as_planned = replace(as_planned, bound=assigner.bound())
    plan = assigner.assign(as_planned.makespan)
    if plan is None:
        return as_planned
    try:
        other = deorder(task, plan)
    except WrongValue as reason:
        log.debug("robot assignment discarded: %s", reason)
        return as_planned
    assigned = as_early_as_possible(task, other, durations)
    return replace(assigned, bound=as_planned.bound) if assigned.makespan < as_planned.makespan else as_planned


def as_early_as_possible(task: PlanningTask, order: PartialOrder, durations: Durations) -> Schedule:
    """Returns the schedule with the robots of an order, each step as early as the order lets it."""
    steps: list[Scheduled] = []
    for index, (step, before) in enumerate(zip(order.steps, order.predecessors(), strict=True)):
        start = max((steps[i].end for i in before), default=0.0)
        end = start + seconds_of(task, step, durations)
        steps.append(Scheduled(index, task.ground(step).robot, start, end))
    return Schedule(order, tuple(steps), max((s.end for s in steps), default=0.0))


def seconds_of(task: PlanningTask, step: PlanStep, durations: Durations) -> float:
    """Returns the expected duration of a step (s)."""
    action = task.action(step.action)
    return durations.seconds(action.skill, action.manager_of(task.ground(step).robot))
