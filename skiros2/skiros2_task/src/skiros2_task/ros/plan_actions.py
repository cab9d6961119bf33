"""The actions that plan without executing: `~plan`, and `~task_plan` of the original task manager."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.ros.goal_server import ACTIVE, GoalServer, is_cancelled
from skiros2_msgs.msg import (
    AssignTaskAction,
    AssignTaskFeedback,
    AssignTaskResult,
    MakePlanAction,
    MakePlanFeedback,
    MakePlanResult,
)
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.given_plan import GivenPlan, is_given_plan, read_given_plan
from skiros2_task.core.plan import Plan
from skiros2_task.core.planners import Planner, Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict, report_of
from skiros2_task.core.preview import Preview
from skiros2_task.ros.task_manager_interface import FAILED, NOTHING_TO_DO, PLAN
from skiros2_task.ros.task_message import Offered, task_holder

log = logging.getLogger(__name__)

#: From the receipt of a goal to its start (s); see `GoalServer`.
START_DELAY = 0.05

_FAILURES = (Verdict.IMPOSSIBLE, Verdict.TIMED_OUT, Verdict.FAILED)


def end_goal(handle: Any, verdict: Verdict, result: object, text: str) -> None:
    """Ends a goal with a result.

    :param handle: the goal's handle, of actionlib.
    """
    if verdict in (Verdict.PLANNED, Verdict.NOTHING_TO_DO):
        handle.set_succeeded(result, text)
    elif verdict is Verdict.CANCELLED:
        handle.set_canceled(result, text)
    else:
        handle.set_aborted(result, text)


class PlanningOptions:
    """Reads the options of goals.

    :param processes: for the planners.
    """

    def __init__(self, processes: EngineProcesses) -> None:
        self._processes = processes

    def limits(self, seconds: float) -> Limits | None:
        """Returns the limits for a time limit (s); None for 0.

        :raises WrongValue: the time limit is negative or infinite.
        """
        if not 0.0 <= seconds < float("inf"):
            raise WrongValue(f"seconds is {seconds}, expected a planning time, or 0")
        return Limits(seconds) if seconds else None

    def planner(self, quality: str) -> Planner | GivenPlan | None:
        """Returns the planner for a quality, or the given plan in its place; None for "".

        :raises WrongValue: the quality is unknown, or the plan cannot be read.
        """
        if is_given_plan(quality):
            return read_given_plan(quality)
        known = [each.value for each in Quality]
        if quality and quality not in known:
            raise WrongValue(f"quality {quality!r} is unknown, expected one of: {', '.join(known)}")
        return planner_named(self._processes, quality) if quality else None


class _PlanningAction(GoalServer):
    """Plans each goal in its own thread. Subclasses define how, and the result."""

    def __init__(self, name: str, spec: Any) -> None:
        super().__init__(name, spec, delay=START_DELAY)
        #: Replaced by the thread of the goals, never changed.
        self._running: tuple[tuple[Any, threading.Thread, threading.Event], ...] = ()

    def plan(self, goal: Any, cancelled: threading.Event, progress: Callable[[str], None]) -> PlanningResult:
        """Plans a goal. Called in the goal's thread."""
        raise NotImplementedError

    def feedback(self, number: int, text: str) -> object:
        """Returns the feedback message of the n-th activity."""
        raise NotImplementedError

    def result(self, result: PlanningResult) -> object:
        """Returns the result message. Called in the goal's thread."""
        raise NotImplementedError

    def close(self, timeout: float = 1.0) -> None:
        """Cancels all goals; clients get their results."""
        running = list(self._running)
        for _, _, cancelled in running:
            cancelled.set()
        for _, thread, _ in running:
            thread.join(timeout)
        super().close(timeout)

    # -- in the threads of the action --------------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        cancelled = threading.Event()
        thread = threading.Thread(target=self._serve_goal, args=(handle, cancelled), name="plan", daemon=True)
        active = [running for running in self._running if running[1].is_alive()]
        self._running = (*active, (handle, thread, cancelled))
        handle.set_accepted()
        if is_cancelled(handle):
            cancelled.set()
        thread.start()

    def _cancel(self, handle: Any) -> None:
        for known, _, cancelled in self._running:
            if known == handle:
                cancelled.set()

    def _unserved_result(self, cancelled: bool, message: str) -> object:
        return self.result(PlanningResult(Verdict.CANCELLED if cancelled else Verdict.FAILED, message))

    def _unfinished_handles(self) -> list[Any]:
        return [handle for handle, _, _ in self._running]

    # -- in the thread of a goal -------------------------------------------------------------------------------

    def _serve_goal(self, handle: Any, cancelled: threading.Event) -> None:
        goal, count = handle.get_goal(), 0

        def progress(text: str) -> None:
            nonlocal count
            count += 1
            log.info("%s", text)
            handle.publish_feedback(self.feedback(count, text))

        log.info("goal of %s: %s", goal.author or "unknown", goal.goals)
        try:
            planned = self.plan(goal, cancelled, progress)
            result = self.result(planned)
        except Exception as error:  # the client still gets a result
            message = str(error)
            if not isinstance(error, SkirosError):
                log.exception("planning %s", goal.goals)
                message = f"internal error: {type(error).__name__}: {error}"
            planned = PlanningResult(Verdict.FAILED, message)
            result = self.result(planned)
        if handle.get_goal_status().status not in ACTIVE:
            return  # the server was closed meanwhile
        if planned.warning:
            handle.publish_feedback(self.feedback(count + 1, planned.warning))
        log.log(_level(planned), "%s", planned.message)
        text = "; ".join(filter(None, (planned.verdict.value, planned.warning)))
        end_goal(handle, planned.verdict, result, text if planned.plan else planned.message)


def _level(result: PlanningResult) -> int:
    if result.verdict in _FAILURES:
        return logging.ERROR
    return logging.WARNING if result.warning else logging.INFO


class TaskPlanAction(_PlanningAction):
    """The action `~task_plan`. The result has the plan as a task for a skill manager."""

    def __init__(self, planner: TaskPlanner, offered: Offered) -> None:
        """
        :param offered: returns the parameters of skills as their managers list them.
        """
        super().__init__("~task_plan", AssignTaskAction)
        self._planner = planner
        self._offered = offered

    def plan(self, goal: Any, cancelled: threading.Event, progress: Callable[[str], None]) -> PlanningResult:
        # Unlike the goal executor, the client may have values: it gets a plan that lacks some, with a warning.
        return self._planner.plan(goal.goals, cancelled, progress, goal.author, leave_open=True)

    def feedback(self, number: int, text: str) -> object:
        return AssignTaskFeedback(number, text)

    def result(self, result: PlanningResult) -> object:
        if result.plan is not None:
            return AssignTaskResult(PLAN, task_holder(result.calls, self._offered).toJson())
        return AssignTaskResult(NOTHING_TO_DO if result.verdict is Verdict.NOTHING_TO_DO else FAILED, result.message)


class PlanAction(_PlanningAction):
    """The action `~plan`. The result has the plan with its order, schedule, purpose and simulation."""

    def __init__(self, planner: TaskPlanner, options: PlanningOptions, simulate: Callable[[Plan], Preview]) -> None:
        """
        :param simulate: simulates a plan on a copy of the scene.
        """
        super().__init__("~plan", MakePlanAction)
        self._planner = planner
        self._options = options
        self._simulate = simulate

    def plan(self, goal: Any, cancelled: threading.Event, progress: Callable[[str], None]) -> PlanningResult:
        return self._planner.plan(
            goal.goals,
            cancelled,
            progress,
            limits=self._options.limits(goal.seconds),
            planner=self._options.planner(goal.quality),
        )

    def feedback(self, number: int, text: str) -> object:
        return MakePlanFeedback(text)

    def result(self, result: PlanningResult) -> object:
        return MakePlanResult(**report_of(result, self._simulate))
