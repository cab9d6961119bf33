"""The skill manager: one robot's skills, as a ROS node offers them."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import rospy
from std_msgs.msg import Bool, Empty

from skiros2_common.core.errors import FOREIGN_ERRORS, ConfigurationError, SkirosError, UnknownName
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.wording import short_name
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_common.ros.signals import RosSignals
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.client.port import ENDED
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.library.reload import reloading
from skiros2_skill.core.lint.linter import log_findings
from skiros2_skill.core.runtime.diagnosis import add_authors, inspection_json
from skiros2_skill.core.runtime.history import History
from skiros2_skill.core.runtime.request import TaskStarter
from skiros2_skill.core.runtime.safety_sources import SafetySettings
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.discovery_interface import DiscoverableNode
from skiros2_skill.ros.execute_action import ExecuteAction
from skiros2_skill.ros.messages import (
    ProgressPublisher,
    declare_on_topic,
    explanations_json,
    param_messages,
    skill_request,
    wire_text,
)
from skiros2_skill.ros.registration import ROBOT_PARAMETER, Registration
from skiros2_skill.ros.safety import SafetyMonitor
from skiros2_skill.ros.skill_layer_interface import NAMESPACE
from skiros2_skill.ros.stop_service import ALL, PAUSE_TIMEOUT, StopService
from skiros2_world_model.core.last_will import last_will_author

log = logging.getLogger(__name__)

TICK_RATE = 25.0  # per second
PREEMPT_TIMEOUT = 10.0  # s

#: How long `tick_once` waits for the tick in progress (s); limited because a hook may send the command.
TICK_TIMEOUT = 5.0


@contextmanager
def _cause_of_missing_robot() -> Iterator[None]:
    """Reports that the scene was refused, if it was, in place of its consequence: that it lacks the robot."""
    try:
        yield
    except ConfigurationError as error:
        refused = (rospy.get_param("wm/refused", None) or {}).get("scene")
        if not refused:
            raise
        raise ConfigurationError(f"{refused}; so the scene is blank, without this robot") from error


class SkillManager(DiscoverableNode):
    """Offers a robot's skills over ROS. Call `start` after loading, and `shutdown` at the end.

    :param robot_name: the agent's name, without slash; the services are private names of the running node.
    :param prefix: ontology prefix of the robot's individual.
    :param wmi: the world model; None creates a `WorldModelInterface` with a replica.
    :param tick_rate: ticks per second.
    :param preempt_timeout: s that a preempted task has to end; see `Scheduler`.
    :param safety: the sources of stops of the robot, and what they do with tasks; None: no source.
    """

    def __init__(
        self,
        robot_name: str,
        prefix: str = "skiros",
        wmi: WorldModelPort | None = None,
        tick_rate: float = TICK_RATE,
        preempt_timeout: float = PREEMPT_TIMEOUT,
        safety: SafetySettings | None = None,
    ) -> None:
        if wmi is None:
            from skiros2_world_model.ros.world_model_interface import WorldModelInterface

            wmi = WorldModelInterface(rospy.get_name(), make_cache=True)
        self._wmi = wmi
        self._library = SkillLibrary(wmi, log_findings)
        self._registration = Registration(wmi, prefix, robot_name, rospy.get_name(), _publish_robot, declare_on_topic())
        self._tick_rate = tick_rate
        self._preempt_timeout = preempt_timeout
        self._safety_settings = safety or SafetySettings()
        self._history = History()
        self._ready = threading.Event()
        self._registering = threading.Lock()
        self._is_over = False
        self._scheduler: Scheduler | None = None
        self._world_state = ""  # the last change's snapshot id

    @property
    def library(self) -> SkillLibrary:
        return self._library

    def load(self, libraries: Sequence[str], primitives: Sequence[str] = (), skills: Sequence[str] = ()) -> None:
        """Loads skills by class name from Python packages.

        :raises ConfigurationError: a package or class does not exist, or cannot be loaded.
        """
        self._library.import_libraries(libraries)
        self._library.load([*primitives, *skills])

    def start(self) -> None:
        """Registers the robot and its skills in the world model, and offers the services; no-op after `shutdown`.

        :raises ConfigurationError: the robot can be neither found nor instantiated.
        """
        with self._registering:
            if not self._is_over:
                self._start()

    def _start(self) -> None:
        with _cause_of_missing_robot():
            self._registration.register(self._library.implementations())
        self._wmi.add_listener(self._on_world_change)
        self._tick_pub = rospy.Publisher("~tick_rate", Empty, queue_size=20)
        self._debug_sub = rospy.Subscriber("~set_debug", Bool, self._on_debug)
        self._progress, self._signals = ProgressPublisher(), RosSignals()
        self._scheduler = tasks = Scheduler(
            self._tick_rate, self._tick_pub.publish, self._on_progress, preempt_timeout=self._preempt_timeout,
            signals=self._signals, collects_evidence=self._progress.wants_evidence,
        )  # fmt: skip
        self._starter = TaskStarter(self._library, self._wmi, tasks, self._history, lambda: self._registration.robot)
        self._execute = ExecuteAction(self._starter, tasks)
        self._safety = SafetyMonitor(self._safety_settings, tasks)
        self._services = [
            rospy.Service("~get_skills", srvs.ResourceGetDescriptions, self._on_get_skills),
            rospy.Service("~command", srvs.SkillCommand, self._on_command),
            StopService(tasks, lambda: _catch_up(self._wmi)).offer(),
            rospy.Service("~reload", srvs.SkillReload, self._on_reload),
            rospy.Service("~tasks", srvs.SkillTasks, self._on_tasks),
            rospy.Service("~why", srvs.SkillWhy, self._on_why),
            rospy.Service("~inspect", srvs.SkillInspection, self._on_inspect),
            rospy.Service("~preview", srvs.SkillPreview, self._on_preview),
            rospy.Service("~breakpoint", srvs.SkillBreakpoint, self._on_breakpoint),
        ]
        self._execute.start()
        self.init_discovery(NAMESPACE, rospy.get_name())
        self._ready.set()
        labels = ", ".join(i.label for i in self._library.implementations()) or "none"
        log.info("%s runs robot %s with skills: %s", rospy.get_name(), self._registration.robot_id, labels)

    def shutdown(self) -> None:
        """Preempts all tasks, removes the skills from the world model, and closes the services."""
        with self._registering:
            self._is_over = True
        if self._scheduler is None or not self._ready.is_set():
            return  # not fully started: the last will unregisters it
        self.stop_discovery()
        for service in self._services:
            service.shutdown()
        self._safety.close()
        self._scheduler.stop()
        self._signals.close()
        self._execute.close()
        self._wmi.remove_listener(self._on_world_change)
        with self._registering:
            try:
                self._registration.unregister()
            except SkirosError as error:
                log.info("the skills of %s stay in the world model: %s", self._registration.robot_id, error)
        self._progress.close()
        self._tick_pub.unregister()
        self._debug_sub.unregister()
        self._scheduler = None

    # -- services ----------------------------------------------------------------------------------------------

    def _on_get_skills(self, _: Any) -> Any:
        self._ready.wait()
        return srvs.ResourceGetDescriptionsResponse(
            [
                msgs.ResourceDescription(i.type, i.label, param_messages(i.declared.params.getParamMap()))
                for i in self._library.implementations()
            ]
        )

    def _on_reload(self, request: Any) -> Any:
        try:
            names = self.reload(request.libraries)
        except SkirosError as error:
            log.error("nothing is reloaded: %s", error)
            return srvs.SkillReloadResponse(False, f"nothing is reloaded: {error}")
        text = f"reloaded {', '.join(names) or 'no libraries'}"
        log.info("%s", text)
        return srvs.SkillReloadResponse(True, text)

    def reload(self, libraries: Sequence[str] = ()) -> list[str]:
        """Reloads libraries with their present source and registers their skills.

        Running tasks keep the old code. A failure changes nothing.

        :param libraries: loaded packages; packages that use them are reloaded too. Empty: all.
        :returns: the requested packages.
        :raises SkirosError: the new code cannot be loaded, or the world model refuses.
        """
        with self._registering:
            old = self._library
            with reloading(old, libraries) as fresh:
                try:
                    self._registration.register_skills(fresh.implementations())
                except SkirosError:
                    self._registration.register_skills(old.implementations())
                    raise
            self._library = self._starter.library = fresh
        return list(libraries or old.libraries)

    def _on_command(self, request: Any) -> Any:
        scheduler = self._running()
        commands: dict[str, Callable[[Any], int]] = {
            request.START: self._on_start,
            request.PREEMPT: lambda r: _for_tasks(
                r.execution_id, partial(scheduler.preempt, by=r.author), partial(scheduler.preempt_all, by=r.author)
            ),
            request.PAUSE: self._on_pause,
            request.TICK_ONCE: lambda r: self._on_start(r, ticks=1),
        }
        try:
            command = _command_of(request.action, commands)
            if request.execution_id < ALL:
                raise UnknownName(f"no task {request.execution_id} is here; ids begin at 0, and -1 means new or all")
            task_id = command(request)
        except SkirosError as error:
            text = f"{short_name(request.action)} by {short_name(request.author or 'unknown')} refused: {error}"
            log.warning("%s", text)
            raise rospy.ServiceException(text) from error
        log.info("%s by %s: task %s", request.action, short_name(request.author or "unknown"), task_id)
        return srvs.SkillCommandResponse(True, task_id)

    def _running(self) -> Scheduler:
        assert self._scheduler is not None
        return self._scheduler

    def _on_start(self, request: Any, ticks: int = 0) -> int:
        scheduler = self._running()
        if request.execution_id == ALL:
            task_id = self._starter.start(request.author, [skill_request(skill) for skill in request.skills], ticks)
        else:
            _catch_up(self._wmi)
            task_id = int(request.execution_id)
            scheduler.start(task_id, ticks)
        if ticks and not scheduler.wait_until_idle([task_id], TICK_TIMEOUT):
            log.warning("task %s: its tick takes longer than %s s; it is paused after it", task_id, TICK_TIMEOUT)
        return task_id

    def _on_pause(self, request: Any) -> int:
        scheduler = self._running()
        ids = [task.id for task in scheduler.tasks()] if request.execution_id == ALL else [request.execution_id]
        task_id = _for_tasks(request.execution_id, scheduler.pause, scheduler.pause_all)
        scheduler.wait_until_idle(ids, PAUSE_TIMEOUT)
        return task_id

    def _on_debug(self, message: Any) -> None:
        self._progress.with_params = message.data

    # -- diagnosis services ------------------------------------------------------------------------------------

    def _on_tasks(self, request: Any) -> Any:
        tasks = self._history.ended if request.task_id == ENDED else _of_id(self._running().tasks(), request.task_id)
        return srvs.SkillTasksResponse([msgs.TreeProgress(self._progress.nodes(task)) for task in tasks])

    def _on_why(self, request: Any) -> Any:
        try:
            record = self._history.get(request.task_id)
        except UnknownName as error:
            return srvs.SkillWhyResponse(False, str(error), "[]")
        add_authors(record.explanations, self._wmi)
        return srvs.SkillWhyResponse(True, wire_text(str(record)), explanations_json(record.explanations))

    def _on_inspect(self, request: Any) -> Any:
        try:
            inspection = inspection_json(self._history.task(request.task_id), request.node_id, self._wmi)
        except UnknownName as error:
            return srvs.SkillInspectionResponse(False, str(error), "")
        return srvs.SkillInspectionResponse(True, "", inspection)

    def _on_preview(self, request: Any) -> Any:
        try:
            preview = self._starter.preview([skill_request(skill) for skill in request.skills], request.partial)
        except SkirosError as error:
            raise rospy.ServiceException(str(error)) from error
        if preview.refusal is not None:
            return srvs.SkillPreviewResponse(False, "", [], json.dumps(preview.refusal.to_dict()))
        params = {key: Param(key, "", element, ParamTypes.Inferred) for key, element in preview.elements.items()}
        for key in preview.values.keys() - params.keys():
            params[key] = Param(key, "", preview.values[key], ParamTypes.Optional)
        return srvs.SkillPreviewResponse(True, preview.label, param_messages(params), "")

    def _on_breakpoint(self, request: Any) -> Any:
        commands: dict[str, Callable[[Any], int]] = {
            request.ADD: self._add_breakpoint,
            request.REMOVE: self._remove_breakpoint,
            request.LIST: lambda _: 0,
        }
        try:
            command = _command_of(request.action, commands)
            number = command(request)
        except SkirosError as error:
            text = f"{short_name(request.action)} refused: {error}"
            log.warning("breakpoint: %s", text)
            raise rospy.ServiceException(text) from error
        return srvs.SkillBreakpointResponse(True, number, _breakpoints_json(self._running().breakpoints.all()))

    def _add_breakpoint(self, request: Any) -> int:
        breakpoint = Breakpoint(request.kind, request.pattern, request.when)
        number = self._running().breakpoints.add(breakpoint)
        log.info("breakpoint %s: %s", number, breakpoint)
        return number

    def _remove_breakpoint(self, request: Any) -> int:
        numbers = self._running().breakpoints.all() if request.number == ALL else [request.number]
        for number in numbers:
            self._running().breakpoints.remove(number)
        return int(request.number)

    # -- progress, in the ticking threads ----------------------------------------------------------------------

    def _on_progress(self, task: Task) -> None:
        # The record is in the history before the end is published, and the client gets its result in any case.
        record = self._history.end(task) if task.ended.is_set() else None
        try:
            progress = self._progress.publish(task, self._execute.needs_feedback(task))
            self._execute.publish_feedback(task, progress)
        finally:
            if record is not None:
                self._execute.end(task, record)

    # -- the world model ---------------------------------------------------------------------------------------

    def _on_world_change(self, change: Any) -> None:
        if self._scheduler is not None:
            try:
                self._scheduler.on_change(change)
            except FOREIGN_ERRORS:  # a condition of a library
                log.exception("waking tasks after change %s", change.snapshot_id)
        known, self._world_state = self._world_state, change.snapshot_id
        will_executed = change.author == last_will_author(rospy.get_name())  # alive, but it was unreachable
        robot_gone = change.action.startswith(msgs.WmMonitor.REMOVE) and any(
            element.id == self._registration.robot_id for element in change.elements
        )
        if will_executed or robot_gone or change.action == msgs.WmMonitor.RESET or change.prev_snapshot_id != known:
            # Replaced, or changes were missed. In a new thread, because this one delivers changes.
            threading.Thread(target=self._register_again, name="register", daemon=True).start()

    def _register_again(self) -> None:
        """Registers the robot and its skills if the world model has lost them."""
        with self._registering:
            if self._scheduler is None:
                return
            try:
                if self._registration.register(self._library.implementations()):
                    log.info("the world model had lost %s, which is registered again", self._registration.robot_id)
            except SkirosError as error:
                log.error("the world model has another scene, and the robot cannot be registered: %s", error)


def _publish_robot(robot_id: str) -> None:
    """Sets the parameter by which task managers know which robot this manager has registered."""
    try:
        rospy.set_param(f"~{ROBOT_PARAMETER}", robot_id)
    except (OSError, rospy.ROSException) as error:
        log.warning("the parameter ~%s is not set, because the master does not answer: %s", ROBOT_PARAMETER, error)


def _catch_up(wmi: WorldModelPort) -> None:
    """Updates the world model: the client may have changed it just before resuming a task."""
    try:
        wmi.catch_up()
    except SkirosError as error:
        log.warning("a task is resumed though the world model does not answer: %s", error)


def _breakpoints_json(known: Mapping[int, Breakpoint]) -> str:
    return json.dumps([{"number": n, "kind": b.kind, "pattern": b.pattern, "when": b.when} for n, b in known.items()])


def _command_of(action: str, commands: Mapping[str, Callable[[Any], int]]) -> Callable[[Any], int]:
    if action not in commands:
        raise UnknownName(f"unknown action {short_name(action)!r}, expected one of: {', '.join(commands)}")
    return commands[action]


def _of_id(tasks: Iterable[Task], task_id: int) -> list[Task]:
    return [task for task in tasks if task_id in (ALL, task.id)]


def _for_tasks(execution_id: int, one: Callable[[int], None], all_tasks: Callable[[], None]) -> int:
    """Applies a command to one task or to all. Returns the id."""
    if execution_id == ALL:
        all_tasks()
    else:
        one(execution_id)
    return execution_id
