"""The connections to the skill managers and to the task manager."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import rosgraph
import roslib.message
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from skiros2_common.command_line.master import XMLRPC_ERRORS
from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.core.forward_clock import now
from skiros2_gui.app.events import GoalProgress, TaskProgress
from skiros2_gui.app.system import clock
from skiros2_live.ros.tree_progress import QuickTreeProgress
from skiros2_msgs import msg as msgs
from skiros2_msgs.msg import SafetyStatus
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.ros.discovery_interface import DiscoveryInterface
from skiros2_skill.ros.skill_layer_interface import NAMESPACE
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION, TaskManagerInterface
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)

#: Messages queued for each manager; older ones are dropped.
_QUEUE = 200


class ManagerConnections(DiscoveryInterface):
    """Discovers managers and subscribes to their progress. A manager that has disconnected stays in `states`.

    :param author: identifies this window in the managers' logs.
    :param on_progress: called with each state of a task, in ROS threads.
    :param on_change: called when a manager has connected or disconnected, in ROS threads.
    :param on_stop: called when the safety state of a robot has changed, in ROS threads.
    """

    def __init__(
        self,
        author: str,
        on_progress: Callable[[TaskProgress], None],
        on_change: Callable[[], None],
        on_stop: Callable[[], None],
    ) -> None:
        self._author = author
        self._report = on_progress
        self._on_change = on_change
        self._on_stop = on_stop
        self._up: dict[str, ManagerClient] = {}
        self._since: dict[str, float] = {}
        self._subscribers: dict[str, Any] = {}
        self._safety_subscribers: dict[str, Any] = {}
        self._safety: dict[str, Any] = {}  # the last `SafetyStatus` of each connected manager
        self._connected: set[str] = set()  # managers whose publisher has connected
        self.init_discovery(NAMESPACE, self._on_up, self._on_down)

    @property
    def managers(self) -> dict[str, ManagerClient]:
        """The connected managers, by node name."""
        with self._discovery_lock:
            return dict(sorted(self._up.items()))

    def states(self) -> list[tuple[str, bool, float]]:
        """Returns name, whether it is up, and since when (s since the epoch) for each manager seen so far."""
        with self._discovery_lock:
            return [(name, name in self._up, since) for name, since in sorted(self._since.items())]

    def stop_of(self, name: str) -> tuple[str, str]:
        """Returns the stops of a manager's robot as a sentence, and the kind of the worst; ("", "") for none."""
        status = self._safety.get(name)
        if status is None or not status.stops:
            return "", ""
        text = f"Stopped since {clock(status.since.to_sec())}: {'; '.join(status.stops)}."
        return text, status.state.replace("_", " ")

    def check(self) -> None:
        """Detects closed connections before the discovery times out. To be called periodically."""
        with self._discovery_lock:
            for name, subscriber in list(self._subscribers.items()):
                is_connected = subscriber.get_num_connections() > 0
                if name in self._connected and not is_connected:
                    self._drop(name)
                elif is_connected:
                    self._connected.add(name)

    def close(self) -> None:
        """Disconnects."""
        self.stop_discovery()
        with self._discovery_lock:
            subscribers = [*self._subscribers.values(), *self._safety_subscribers.values()]
            self._subscribers, self._safety_subscribers = {}, {}
        for subscriber in subscribers:
            subscriber.unregister()

    def _on_up(self, name: str) -> None:
        self._up[name] = manager = ManagerClient(name, self._author)
        self._since[name] = time.time()
        self._subscribers[name] = rospy.Subscriber(
            f"{name}/monitor", QuickTreeProgress, self._on_progress, name, queue_size=_QUEUE
        )
        self._safety_subscribers[name] = rospy.Subscriber(f"{name}/safety", SafetyStatus, self._on_safety, name)
        threading.Thread(target=self._catch_up, args=(manager,), name="window tasks", daemon=True).start()
        self._on_change()

    def _on_down(self, name: str) -> None:
        self._up.pop(name).close()
        self._since[name] = time.time()
        self._connected.discard(name)
        self._subscribers.pop(name).unregister()
        self._safety_subscribers.pop(name).unregister()
        self._safety.pop(name, None)
        self._on_change()

    def _on_progress(self, message: Any, name: str) -> None:
        if message.progress:
            self._report(TaskProgress(name, message.progress, now()))

    def _on_safety(self, status: Any, name: str) -> None:
        self._safety[name] = status
        self._on_stop()

    def _catch_up(self, manager: ManagerClient) -> None:
        """Reports the tasks that exist already; a paused task publishes nothing."""
        try:
            tasks = manager.read_tasks()
        except SkirosError as error:
            log.info("%s: reading the tasks failed: %s", manager.name, error)
            return
        for nodes in tasks:
            if nodes:
                self._report(TaskProgress(manager.name, nodes, now()))


#: Without a status message for this time the task manager counts as down (s of wall time). It publishes at 5 Hz.
STATUS_TIMEOUT = 2.0
#: The status of goals that have not ended.
_ACTIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)


class TaskManagerConnection:
    """Watches the task manager `tm` in this node's namespace and sends it goals.

    :param on_progress: called with each message of a goal, in ROS threads.
    :param on_change: called, in any thread, when it has connected or disconnected.
    """

    def __init__(self, on_progress: Callable[[GoalProgress], None], on_change: Callable[[], None]) -> None:
        self.name = rospy.resolve_name(ACHIEVE_ACTION).rpartition("/")[0]
        self.is_up = False
        self.since = 0.0
        self._on_change = on_change
        self._last_status = -STATUS_TIMEOUT
        self.active_goals: frozenset[str] = frozenset()
        self._client: TaskManagerInterface | None = None
        self._goal_lock = threading.Lock()
        self._on_progress = on_progress
        self._cancel: Any = None
        self._status = rospy.Subscriber(f"{ACHIEVE_ACTION}/status", GoalStatusArray, self._on_status, queue_size=1)
        self._goals = [
            rospy.Subscriber(f"{ACHIEVE_ACTION}/{topic}", kind, self._on_goal)
            for topic, kind in (
                ("goal", msgs.AchieveActionGoal),
                ("feedback", msgs.AchieveActionFeedback),
                ("result", msgs.AchieveActionResult),
            )
        ]

    def achieve(self, goals: str, on_feedback: Callable[[Any], None], quality: str = "", seconds: float = 0.0) -> Any:
        """See `app.system.Planner`.

        :raises Refused: another goal of this window is running.
        :raises TimedOut: the task manager does not answer.
        """
        return self._request(
            lambda client: client.achieve(goals, feedback_cb=on_feedback, quality=quality, seconds=seconds)
        )

    def plan(self, goals: str) -> Any:
        """See `app.system.Planner`.

        :raises Refused, TimedOut: see `achieve`.
        """
        return self._request(lambda client: client.make_plan(goals))

    def _request(self, send: Callable[[TaskManagerInterface], None]) -> Any:
        """Sends a request and returns its result."""
        if not self._goal_lock.acquire(blocking=False):
            raise Refused("a goal of this window is running; cancel it, or wait for its end")
        try:
            if self._client is None:
                self._client = TaskManagerInterface()
            send(self._client)
            return self._client.wait_for_result()
        finally:
            self._goal_lock.release()

    def cancel(self) -> None:
        """See `app.system.Planner`."""
        if self._client is not None:
            self._client.preempt()

    def cancel_goal(self, goal_id: str) -> None:
        """See `app.system.Planner`."""
        if self._cancel is None:
            self._cancel = rospy.Publisher(f"{ACHIEVE_ACTION}/cancel", GoalID, queue_size=10)
            self._await_connection(self._cancel)
        self._cancel.publish(GoalID(id=goal_id))

    def _await_connection(self, publisher: Any) -> None:
        """
        :raises TimedOut: the task manager does not connect.
        """
        deadline = time.monotonic() + STATUS_TIMEOUT
        while not publisher.get_num_connections():
            if time.monotonic() > deadline:
                raise TimedOut(f"the task manager {self.name} does not answer")
            time.sleep(0.01)

    def _on_goal(self, message: Any) -> None:
        status = getattr(message, "status", None)
        goal_id = (status or message).goal_id.id
        self._on_progress(GoalProgress(goal_id, message, now()))

    def check(self) -> None:
        """Detects that it is down. To be called periodically."""
        is_silent = time.monotonic() - self._last_status > STATUS_TIMEOUT
        if self.is_up and (is_silent or self._status.get_num_connections() == 0):
            self._set(False)

    def close(self) -> None:
        """Disconnects."""
        for subscriber in (self._status, *self._goals):
            subscriber.unregister()

    def _on_status(self, message: Any) -> None:
        self.active_goals = frozenset(each.goal_id.id for each in message.status_list if each.status in _ACTIVE)
        self._last_status = time.monotonic()
        self._set(True)

    def _set(self, is_up: bool) -> None:
        if is_up != self.is_up:
            self.is_up, self.since = is_up, time.time()
            self._on_change()


#: The service of the simulator that applies forces, and its type; the package need not be installed with the window.
PUSH, PUSH_TYPE = "sim/push", "skiros2_sim_msgs/Push"


class SimulatorConnection:
    """See `app.system.Simulator`."""

    def __init__(self) -> None:
        self._name = str(rospy.resolve_name(PUSH))
        self._pool: ServicePool | None = None
        self._service: Any = None

    def is_up(self) -> bool:
        try:
            rosgraph.Master(rospy.get_name()).lookupService(self._name)
        except (*XMLRPC_ERRORS, rosgraph.MasterException):
            return False
        return True

    def push(self, eid: str, force: tuple[float, float, float], duration: float) -> None:
        if self._pool is None:
            self._service = roslib.message.get_service_class(PUSH_TYPE)
            if self._service is None:
                raise Refused(f"the package of {PUSH_TYPE} is not installed")
            self._pool = ServicePool(self._name, self._service, 0.0)
        request = self._service._request_class(element=eid)
        wrench = request.wrench.force
        wrench.x, wrench.y, wrench.z = force
        request.duration = rospy.Duration(duration)
        answer = self._pool.call(request, False)
        if not answer.ok:
            raise Refused(answer.message)

    def close(self) -> None:
        """Disconnects."""
        if self._pool is not None:
            self._pool.close()
