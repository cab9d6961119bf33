"""The task manager node: plans and achieves goals received by actions."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Collection
from pathlib import Path

import rosgraph
import rospkg
import rospy

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.ros.node import spin
from skiros2_common.ros.parameters import bool_param, integer_param, number_param
from skiros2_common.ros.plugins import load_plugins
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.goal_store import GoalStore, OnRestart, StoreFailed
from skiros2_task.core.held_objects import held_objects
from skiros2_task.core.planners import DEFAULT_ENGINE, planner_named
from skiros2_task.core.planning import TaskPlanner
from skiros2_task.core.preview import preview
from skiros2_task.core.recovery import ROBOTS_TIMEOUT, Restart
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
    seconds = number_param("~planning_time", Limits.seconds, above=0.0, maximum=math.inf, what="seconds")
    max_replans = integer_param("~max_replans", MAX_REPLANS, minimum=0)
    interrupt_priority = integer_param("~interrupt_priority", INTERRUPT_PRIORITY)
    replans_after_limit = bool_param("~replan_after_limit", False)
    on_restart = _on_restart()
    folder = FOLDER.expanduser()
    processes = EngineProcesses()
    store = _open_store()
    try:
        wm = WorldModelInterface(rospy.get_name(), make_cache=True)
        durations = Durations(folder / DURATIONS_FILE)
        engine = planner_named(processes, str(rospy.get_param("~planner", DEFAULT_ENGINE)))
        step_runner = ManagerStepRunner(rospy.get_name(), durations)
        archive = Archive(folder)
        planner = TaskPlanner(wm, engine, Limits(seconds), archive, durations, step_runner.robots)
        executor = GoalExecutor(planner, step_runner, store)
        system = _System(wm, store, on_restart)
        restart = system.restart()
        on_found, on_lost = (system.watch(each, step_runner) for each in (executor.robot_found, executor.robot_lost))
        step_runner.subscribe(on_found, on_lost)
        wm.add_listener(executor.world_changed)
        options = PlanningOptions(processes)
        achieve = AchieveAction(executor, options, max_replans, interrupt_priority, store, replans_after_limit)
        actions = (
            TaskPlanAction(planner, step_runner.offered),
            PlanAction(planner, options, lambda plan: preview(PreviewCopy(wm), plan)),
            achieve,
        )
        rospy.on_shutdown(lambda: executor.close(_STOP_TIMEOUT))
        for action in actions:
            rospy.on_shutdown(action.close)
            action.start()
        achieve.recover(restart)
        system.note_session()
        spin()
    finally:
        if store is not None:
            store.close(delivered=True)
        processes.close()


class _System:
    """The stored part of the system around the goals: the robots that run, and the scene.

    :param store: None: nothing is stored.
    :param on_restart: for goals that have none of their own.
    """

    def __init__(self, wm: WorldModelInterface, store: GoalStore | None, on_restart: OnRestart) -> None:
        self._wm = wm
        self._store = store
        self._on_restart = on_restart
        self._session = ""
        self._started = time.monotonic()
        # Those of a process that left no goal are waited for by none.
        self._earlier = frozenset(store.meta("managers") or () if store is not None and store.open_goals() else ())
        self._found: set[str] = set()

    def restart(self) -> Restart:
        """Returns what the earlier process has left."""
        store = self._store
        if store is None:
            return Restart(frozenset(), lambda _: self._on_restart, lambda _: "")
        earlier = store.meta("session")

        def question(managers: Collection[str]) -> str:
            if earlier and earlier != self._wm.session:
                return "the world model has another scene than before the restart"
            return held_objects(self._wm, managers)

        def on_restart(goal_id: str) -> OnRestart:
            found = store.on_restart(goal_id)
            return self._on_restart if found is None else found

        return Restart(self._earlier, on_restart, question)

    def watch(self, report: Callable[[str], None], runner: ManagerStepRunner) -> Callable[[str], None]:
        """Returns a callback that stores the managers, then reports the one that has appeared or gone.

        A manager that has gone may have been killed, like this process soon: it is stored as well.
        """

        def callback(manager: str) -> None:
            self._found.update(runner.agents)
            is_early = time.monotonic() - self._started < ROBOTS_TIMEOUT
            self._note("managers", sorted(self._found | (self._earlier if is_early else set())))
            self.note_session()
            report(manager)

        return callback

    def note_session(self) -> None:
        """Stores which scene the goals belong to."""
        session = self._wm.session
        if session != self._session:
            self._session = session
            self._note("session", session)

    def _note(self, key: str, value: object) -> None:
        if self._store is None:
            return
        try:
            self._store.set_meta(key, value)
        except StoreFailed as error:
            log.error("%s", error)


def _open_store() -> GoalStore | None:
    """Opens the store that `~goals` names: true (a file for each master and node name), false, or a file.

    :raises ConfigurationError: it cannot be opened.
    """
    wanted = rospy.get_param("~goals", True)
    if not wanted:
        return None
    if isinstance(wanted, str):
        return GoalStore(Path(wanted).expanduser())
    host, port = rosgraph.network.parse_http_host_and_port(rosgraph.get_master_uri())
    return GoalStore(Path(rospkg.get_ros_home()) / "skiros2" / f"{host}_{port}{rospy.get_name()}.goals")


def _on_restart() -> OnRestart:
    """
    :raises ConfigurationError: the parameter has no valid value.
    """
    try:
        return OnRestart.named(str(rospy.get_param("~on_restart", "")))
    except WrongValue as error:
        raise ConfigurationError(f"parameter {rospy.resolve_name('~on_restart')}: {error}") from None
