"""The task manager node: plans and achieves goals received by actions."""

from __future__ import annotations

import logging
import os
import threading
from pathlib import Path
from typing import Any

import actionlib
import rospy

from skiros2_common.core.errors import ConfigurationError, SkirosError, WrongValue
from skiros2_common.ros.shutdown import spin
from skiros2_msgs.msg import AssignTaskAction, AssignTaskFeedback, AssignTaskResult
from skiros2_task.core.archive import Archive
from skiros2_task.core.durations import Durations
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.planner import Limits, Planner
from skiros2_task.core.planners import DEFAULT_ENGINE, Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.ros.achieve_action import MAX_REPLANS, AchieveAction
from skiros2_task.ros.step_runner import ManagerStepRunner
from skiros2_task.ros.task_manager_interface import FAILED, NOTHING_TO_DO, PLAN
from skiros2_task.ros.task_message import Offered, task_holder
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: The folder for the files of the last plans.
ARCHIVE = Path("~/.skiros/planner")

#: The file in it with the measured durations of skills.
DURATIONS = "durations.json"

#: The grace period for running steps when the node ends (s).
_STOP_TIMEOUT = 1.0


class TaskManager:
    """The action server `~task_plan`. Plans each goal in its own thread."""

    def __init__(self, planner: TaskPlanner, offered: Offered) -> None:
        """
        :param offered: returns the parameters of skills as their managers list them.
        """
        self._planner = planner
        self._offered = offered
        self._lock = threading.Lock()  # never held in a call of actionlib, which holds its own lock in callbacks
        self._running: dict[str, tuple[threading.Thread, threading.Event]] = {}
        self._server = actionlib.ActionServer(
            "~task_plan", AssignTaskAction, self._on_goal, self._on_cancel, auto_start=False
        )

    def start(self) -> None:
        """Starts the action server."""
        self._server.start()

    def stop(self) -> None:
        """Cancels all goals and waits until they have ended."""
        with self._lock:
            running = list(self._running.values())
        for _, cancelled in running:
            cancelled.set()
        for thread, _ in running:
            thread.join()

    # Called by ROS threads, one goal at a time.

    def _on_goal(self, handle: Any) -> None:
        cancelled = threading.Event()
        thread = threading.Thread(target=self._serve, args=(handle, cancelled), name="plan")
        goal_id = handle.get_goal_id().id
        with self._lock:
            self._running[goal_id] = (thread, cancelled)
        handle.set_accepted()
        thread.start()

    def _on_cancel(self, handle: Any) -> None:
        goal_id = handle.get_goal_id().id
        with self._lock:
            running = self._running.get(goal_id)
        if running is not None:
            running[1].set()

    # In the goal's thread.

    def _serve(self, handle: Any, cancelled: threading.Event) -> None:
        goal, goal_id = handle.get_goal(), handle.get_goal_id().id
        log.info("goal of %s: %s", goal.author or "unknown", goal.goals)
        try:
            result = self._plan(handle, goal, cancelled)
            self._answer(handle, result)
        finally:
            with self._lock:
                del self._running[goal_id]

    def _plan(self, handle: Any, goal: Any, cancelled: threading.Event) -> PlanningResult:
        steps = 0

        def progress(text: str) -> None:
            nonlocal steps
            steps += 1
            log.info("%s", text)
            handle.publish_feedback(AssignTaskFeedback(steps, text))

        try:
            return self._planner.plan(goal.goals, cancelled, progress, goal.author)
        except SkirosError as error:
            return PlanningResult(Verdict.FAILED, message=str(error))
        except Exception as error:  # the client still gets a result
            log.exception("planning %s", goal.goals)
            return PlanningResult(Verdict.FAILED, message=f"internal error: {type(error).__name__}: {error}")

    def _answer(self, handle: Any, result: PlanningResult) -> None:
        log.log(logging.INFO if _code(result) != FAILED else logging.ERROR, "%s", _line(result))
        if result.verdict is Verdict.PLANNED:
            handle.set_succeeded(AssignTaskResult(PLAN, task_holder(result.calls, self._offered).toJson()), "planned")
        elif result.verdict is Verdict.NOTHING_TO_DO:
            handle.set_succeeded(AssignTaskResult(NOTHING_TO_DO, result.message), result.message)
        elif result.verdict is Verdict.CANCELLED:
            handle.set_canceled(AssignTaskResult(FAILED, result.message), result.message)
        else:
            handle.set_aborted(AssignTaskResult(FAILED, result.message), result.message)


def _code(result: PlanningResult) -> int:
    return {Verdict.PLANNED: PLAN, Verdict.NOTHING_TO_DO: NOTHING_TO_DO}.get(result.verdict, FAILED)


def _line(result: PlanningResult) -> str:
    return f"plan of {len(result.calls)} steps:\n{result.message}" if result.calls else result.message


def main() -> None:
    """Serves the actions until ROS shuts down.

    :raises ConfigurationError: a ROS parameter has an invalid value.
    """
    seconds = rospy.get_param("~planning_time", Limits.seconds)
    if not isinstance(seconds, int | float) or isinstance(seconds, bool) or seconds <= 0:
        raise ConfigurationError(f"parameter {rospy.resolve_name('~planning_time')} is {seconds!r}, expected seconds")
    max_replans = rospy.get_param("~max_replans", MAX_REPLANS)
    if not isinstance(max_replans, int) or isinstance(max_replans, bool) or max_replans < 0:
        name = rospy.resolve_name("~max_replans")
        raise ConfigurationError(f"parameter {name} is {max_replans!r}, expected a number of plans")
    folder = Path(os.path.expanduser(ARCHIVE))
    processes = EngineProcesses()
    try:
        wm = WorldModelInterface(rospy.get_name(), make_cache=True)
        durations = Durations(folder / DURATIONS)
        engine = planner_named(processes, str(rospy.get_param("~planner", DEFAULT_ENGINE)), durations)
        step_runner = ManagerStepRunner(rospy.get_name(), durations)
        archive = Archive(folder)
        planner = TaskPlanner(wm, engine, Limits(float(seconds)), archive, durations, lambda: step_runner.agents)
        executor = GoalExecutor(planner, step_runner)
        step_runner.subscribe(executor.robot_found, executor.robot_lost)
        wm.add_listener(lambda _: executor.world_changed())
        manager = TaskManager(planner, step_runner.offered)
        achieve = AchieveAction(executor, lambda quality: _planner_for(quality, processes, durations), max_replans)
        rospy.on_shutdown(lambda: executor.close(_STOP_TIMEOUT))
        rospy.on_shutdown(manager.stop)
        rospy.on_shutdown(achieve.close)
        manager.start()
        achieve.start()
        spin()
    finally:
        processes.close()


def _planner_for(quality: str, processes: EngineProcesses, durations: Durations) -> Planner:
    """Returns the planner for a plan quality.

    :raises WrongValue: the quality is unknown.
    """
    known = [each.value for each in Quality]
    if quality not in known:
        raise WrongValue(f"quality {quality!r} is unknown, expected one of: {', '.join(known)}")
    return planner_named(processes, quality, durations)
