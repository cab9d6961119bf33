"""The task manager node: plans and achieves goals received by actions."""

from __future__ import annotations

import logging

import rospy

from skiros2_common.core.errors import ConfigurationError
from skiros2_common.ros.node import spin
from skiros2_common.ros.plugins import load_plugins
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.planners import DEFAULT_ENGINE, planner_named
from skiros2_task.core.planning import TaskPlanner
from skiros2_task.core.preview import preview
from skiros2_task.core.store import DURATIONS_FILE, FOLDER, Archive, Durations
from skiros2_task.ros.achieve_action import INTERRUPT_PRIORITY, MAX_REPLANS, AchieveAction
from skiros2_task.ros.plan_actions import PlanAction, PlanningOptions, TaskPlanAction
from skiros2_task.ros.step_runner import ManagerStepRunner
from skiros2_world_model.core.preview_copy import PreviewCopy
from skiros2_world_model.ros.world_model_interface import WorldModelInterface

log = logging.getLogger(__name__)

#: The grace period for running steps when the node ends (s).
_STOP_TIMEOUT = 1.0


def main() -> None:
    """Serves the actions until ROS shuts down.

    :raises ConfigurationError: a ROS parameter has an invalid value.
    """
    load_plugins("skiros2_task")
    seconds = rospy.get_param("~planning_time", Limits.seconds)
    if not isinstance(seconds, int | float) or isinstance(seconds, bool) or seconds <= 0:
        raise ConfigurationError(f"parameter {rospy.resolve_name('~planning_time')} is {seconds!r}, expected seconds")
    max_replans = _integer("~max_replans", MAX_REPLANS, minimum=0)
    interrupt_priority = _integer("~interrupt_priority", INTERRUPT_PRIORITY)
    folder = FOLDER.expanduser()
    processes = EngineProcesses()
    try:
        wm = WorldModelInterface(rospy.get_name(), make_cache=True)
        durations = Durations(folder / DURATIONS_FILE)
        engine = planner_named(processes, str(rospy.get_param("~planner", DEFAULT_ENGINE)))
        step_runner = ManagerStepRunner(rospy.get_name(), durations)
        archive = Archive(folder)
        planner = TaskPlanner(wm, engine, Limits(float(seconds)), archive, durations, step_runner.robots)
        executor = GoalExecutor(planner, step_runner)
        step_runner.subscribe(executor.robot_found, executor.robot_lost)
        wm.add_listener(executor.world_changed)
        options = PlanningOptions(processes)
        actions = (
            TaskPlanAction(planner, step_runner.offered),
            PlanAction(planner, options, lambda plan: preview(PreviewCopy(wm), plan)),
            AchieveAction(executor, options, max_replans, interrupt_priority),
        )
        rospy.on_shutdown(lambda: executor.close(_STOP_TIMEOUT))
        for action in actions:
            rospy.on_shutdown(action.close)
            action.start()
        spin()
    finally:
        processes.close()


def _integer(name: str, default: int, minimum: int | None = None) -> int:
    """
    :raises ConfigurationError: the parameter is no integer, or less than the minimum.
    """
    value = rospy.get_param(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or (minimum is not None and value < minimum):
        expected = "an integer" if minimum is None else f"an integer from {minimum}"
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected {expected}")
    return value
