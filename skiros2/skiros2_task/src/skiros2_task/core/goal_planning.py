"""Plans for a goal in execution. Called in the thread of the goal."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable
from functools import partial

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_task.core.commands import MakePlan
from skiros2_task.core.goal_execution import GoalExecution
from skiros2_task.core.plan import Step
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.task import PlanningTask

log = logging.getLogger(__name__)

#: The verdicts of a goal that can continue, or holds.
GOOD = (Verdict.PLANNED, Verdict.NOTHING_TO_DO)


def internal_error(error: Exception) -> str:
    """Logs an unexpected exception. Returns its text."""
    log.error("executing a goal", exc_info=error)
    return f"internal error: {type(error).__name__}: {error}"


#: How long a device that a robot holds may still be released, and how often that is looked at (s).
_RELEASE_TIME, _RELEASE_PERIOD = 3.0, 0.2


def read_task(planner: TaskPlanner, execution: GoalExecution) -> PlanningTask | SkirosError:
    """Returns the goal's task for the current world, or why it cannot be read."""
    try:
        return planner.read_task(execution.goal.text)
    except Exception as error:
        return error if isinstance(error, SkirosError) else WrongValue(internal_error(error))


def plan_ahead(
    planner: TaskPlanner, execution: GoalExecution, command: MakePlan | None, busy: frozenset[str] = frozenset()
) -> None:
    """Starts the first search of `make_plan`, or ends it if `command` is None. Does not block."""
    goal = execution.goal
    adapt = None if command is None else partial(_adapted, command.running, _avoided(command, busy))
    try:
        planner.plan_ahead(goal.text, execution.cancelled, adapt, goal.limits, goal.planner)
    except SkirosError as error:  # `make_plan` reports it, if it is asked for the plan
        log.debug("planning ahead: %s", error)


def make_plan(
    planner: TaskPlanner, execution: GoalExecution, command: MakePlan, busy: frozenset[str]
) -> tuple[PlanningTask | None, PlanningResult]:
    """Plans first with the robots that are free and the skills that have not failed, then with all.

    Without a plan, it waits for devices that no step of a goal holds any more: a release is repeated after 1 s.

    :param busy: the managers that other goals use.
    :returns: the task for the current world, None if the goal cannot be read; and the result.
    """
    lost = frozenset((manager, "") for manager in command.lost)
    preferred = _avoided(command, busy)
    may_wait = not command.running and not busy and _are_locked(planner)
    for avoided in (preferred, lost) if preferred != lost else (lost,):
        task, result = _result(planner, execution, command.running, avoided)
        if result.verdict in GOOD or result.verdict is Verdict.CANCELLED:
            break
    if may_wait and result.verdict is Verdict.IMPOSSIBLE and _are_released(planner, execution):
        return make_plan(planner, execution, command, busy)
    return task, result


def _are_locked(planner: TaskPlanner) -> bool:
    try:
        return planner.has_locked_devices()
    except SkirosError:  # planning reports it
        return False


def _are_released(planner: TaskPlanner, execution: GoalExecution) -> bool:
    """Waits until no robot holds a device. Returns whether that is so."""
    deadline = time.monotonic() + _RELEASE_TIME
    while _are_locked(planner):
        if execution.cancelled.wait(_RELEASE_PERIOD) or time.monotonic() > deadline:
            return False
    return True


def _avoided(command: MakePlan, busy: frozenset[str]) -> frozenset[tuple[str, str]]:
    return frozenset((manager, "") for manager in command.lost | busy) | command.avoided


def _adapted(running: Iterable[Step], avoided: frozenset[tuple[str, str]], task: PlanningTask) -> PlanningTask:
    facts = task.init
    for step in running:
        facts = step.apply(facts)
    return task.after(facts).without_skills(avoided)


def _result(
    planner: TaskPlanner, execution: GoalExecution, running: Iterable[Step], avoided: frozenset[tuple[str, str]]
) -> tuple[PlanningTask | None, PlanningResult]:
    tasks: list[PlanningTask] = []

    def adapt(task: PlanningTask) -> PlanningTask:
        tasks.append(task)
        return _adapted(running, avoided, task)

    goal = execution.goal
    try:
        result = planner.plan(goal.text, execution.cancelled, limits=goal.limits, planner=goal.planner, adapt=adapt)
    except Exception as error:
        message = str(error) if isinstance(error, SkirosError) else internal_error(error)
        result = PlanningResult(Verdict.FAILED, message)
    return (tasks[0] if tasks else None), result
