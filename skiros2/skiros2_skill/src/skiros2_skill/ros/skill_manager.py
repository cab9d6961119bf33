"""The skill manager: one robot's skills, as a ROS node offers them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from std_msgs.msg import Bool, Empty

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.params import ParamTypes
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.core.library import SkillLibrary
from skiros2_skill.core.request import SkillRequest, make_nodes
from skiros2_skill.core.task import NodeProgress, Task
from skiros2_skill.core.ticker import Ticker
from skiros2_skill.ros.discovery_interface import DiscoverableNode
from skiros2_skill.ros.registration import Registration
from skiros2_skill.ros.skill_layer_interface import NAMESPACE

log = logging.getLogger(__name__)

_WIRE_STATES = {
    State.Success: msgs.SkillProgress.SUCCESS,
    State.Failure: msgs.SkillProgress.FAILURE,
    State.Running: msgs.SkillProgress.RUNNING,
    State.Idle: msgs.SkillProgress.IDLE,
    State.Uninitialized: msgs.SkillProgress.IDLE,
}


class SkillManager(DiscoverableNode):
    """Offers a robot's skills over ROS. `start` when everything is loaded, `shutdown` at the end.

    :param robot_name: the agent's name, without slash; the services are private names of the running node.
    :param prefix: ontology prefix of the robot's individual.
    :param wmi: the world model; None makes a `WorldModelInterface` with a replica.
    :param tick_rate: ticks per second.
    """

    def __init__(self, robot_name: str, prefix: str = "skiros", wmi: Any = None, tick_rate: float = 25.0) -> None:
        if wmi is None:
            from skiros2_world_model.ros.world_model_interface import WorldModelInterface

            wmi = WorldModelInterface(rospy.get_name(), make_cache=True)
        self._wmi = wmi
        self._library = SkillLibrary(wmi)
        self._registration = Registration(wmi, prefix, robot_name, rospy.get_name())
        self._tick_rate = tick_rate
        self._debug = False
        self._ready = threading.Event()
        self._registering = threading.Lock()
        self._ticker: Ticker | None = None
        self._connections: list[Any] = []
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
        """Registers the robot and its skills in the world model, and offers the services.

        :raises ConfigurationError: the robot cannot be found or made.
        """
        self._registration.register_robot()
        self._registration.register_skills(self._library.implementations())
        self._wmi.add_listener(self._on_world_change)
        self._tick_pub = rospy.Publisher("~tick_rate", Empty, queue_size=20)
        self._monitor_pub = rospy.Publisher("~monitor", msgs.TreeProgress, queue_size=100)
        self._ticker = Ticker(self._tick_rate, self._tick_pub.publish, self._publish_progress)
        self._connections = [
            self._tick_pub,
            self._monitor_pub,
            rospy.Subscriber("~set_debug", Bool, self._on_debug),
        ]
        self._services = [
            rospy.Service("~get_skills", srvs.ResourceGetDescriptions, self._on_get_skills),
            rospy.Service("~command", srvs.SkillCommand, self._on_command),
        ]
        self._ready.set()
        self.init_discovery(NAMESPACE, rospy.get_name())
        labels = ", ".join(i.label for i in self._library.implementations()) or "none"
        log.info("%s runs robot %s with skills: %s", rospy.get_name(), self._registration.robot_id, labels)

    def shutdown(self) -> None:
        """Ends all tasks, takes the skills out of the world model, and closes the services."""
        if self._ticker is None:
            return
        self.stop_discovery()
        for service in self._services:
            service.shutdown()
        self._ticker.stop()
        self._wmi.remove_listener(self._on_world_change)
        with self._registering:
            try:
                self._registration.remove_skills()
            except SkirosError as error:
                log.info("the skills of %s stay in the world model: %s", self._registration.robot_id, error)
        for connection in self._connections:
            connection.unregister()
        self._ticker = None

    # -- services ----------------------------------------------------------------------------------------------

    def _on_get_skills(self, _: Any) -> Any:
        self._ready.wait()
        return srvs.ResourceGetDescriptionsResponse(
            [
                msgs.ResourceDescription(i.type, i.label, utils.serializeParamMap(i.declared.params))
                for i in self._library.implementations()
            ]
        )

    def _on_command(self, request: Any) -> Any:
        commands: dict[str, Callable[[Any], int]] = {
            request.START: self._on_start,
            request.PREEMPT: lambda r: self._for_tasks(r.execution_id, self._running().preempt),
            request.PAUSE: lambda r: self._for_tasks(r.execution_id, self._running().pause),
            request.TICK_ONCE: lambda r: self._on_start(r, ticks=1),
        }
        try:
            if request.action not in commands:
                raise UnknownName(f"unknown action {request.action!r}, expected one of: {', '.join(commands)}")
            task_id = commands[request.action](request)
        except SkirosError as error:
            text = f"{request.action} by {request.author or 'unknown'} refused: {error}"
            log.warning("%s", text)
            raise rospy.ServiceException(text) from error
        log.info("%s by %s: task %s", request.action, request.author or "unknown", task_id)
        return srvs.SkillCommandResponse(True, task_id)

    def _running(self) -> Ticker:
        assert self._ticker is not None
        return self._ticker

    def _on_start(self, request: Any, ticks: int = 0) -> int:
        ticker = self._running()
        if request.execution_id >= 0:
            ticker.start(request.execution_id, ticks)
            return int(request.execution_id)
        self._wmi.catch_up()  # the one who asks may just have changed the world that the request speaks of
        requests = [SkillRequest(s.type, s.name, utils.deserializeParamMap(s.params)) for s in request.skills]
        nodes = make_nodes(requests, self._library, self._wmi)
        task = ticker.new_task(self._wmi, request.author)
        task.root.params.addParam("Robot", self._registration.robot, ParamTypes.Inferred, "The manager's robot")
        task.root(*nodes)
        ticker.start(task.id, ticks)
        return task.id

    def _for_tasks(self, execution_id: int, command: Callable[[int], None]) -> int:
        """Gives a command to one task, or with -1 to all."""
        if execution_id >= 0:
            command(execution_id)
        else:
            for task in self._running().tasks():
                command(task.id)
        return execution_id

    def _on_debug(self, message: Any) -> None:
        self._debug = message.data

    # -- progress, in the ticking thread -----------------------------------------------------------------------

    def _publish_progress(self, task: Task) -> None:
        self._monitor_pub.publish(msgs.TreeProgress([self._progress_msg(task, node) for node in task.progress()]))

    def _progress_msg(self, task: Task, node: NodeProgress) -> Any:
        return msgs.SkillProgress(
            robot=rospy.get_name(),
            task_id=task.id,
            id=node.id,
            parent_label=node.parent_label,
            parent_id=node.parent_id,
            type=node.type,
            label=node.label,
            params=utils.serializeParamMap(node.params) if self._debug else [],
            processor=node.processor,
            state=_WIRE_STATES[node.state],
            progress_code=max(-32768, min(node.progress_code, 32767)),
            progress_period=node.progress_period,
            progress_time=node.progress_time,
            progress_message=node.progress_message,
        )

    # -- the world model ---------------------------------------------------------------------------------------

    def _on_world_change(self, change: Any) -> None:
        if self._ticker is not None:
            self._ticker.on_change(change)
        known, self._world_state = self._world_state, change.snapshot_id
        if change.action == msgs.WmMonitor.RESET or change.prev_snapshot_id != known:
            # A new scene, or one that was missed: a world model that was started anew, and has changed since, tells the
            # last change only. Not in this thread: it is the one that brings changes.
            threading.Thread(target=self._register_again, name="register", daemon=True).start()

    def _register_again(self) -> None:
        """Registers the robot and its skills if the world model has not got them any more."""
        with self._registering:
            if self._ticker is None:
                return
            try:
                if self._registration.stands():
                    return
                self._registration.register_robot()
                self._registration.register_skills(self._library.implementations())
                log.info("the world model has another scene: %s is registered again", self._registration.robot_id)
            except SkirosError as error:
                log.error("the world model has another scene, and the robot cannot be registered: %s", error)
