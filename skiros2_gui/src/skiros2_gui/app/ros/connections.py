"""The connections to the task manager and to the simulator."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import rosgraph
import roslib.message
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from skiros2_common.command_line.master import XMLRPC_ERRORS
from skiros2_common.core.errors import Refused, TimedOut
from skiros2_live.core.patch import TASK_MANAGER, Connection, GoalProgress
from skiros2_live.ros.goals import GoalTopics
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION, TaskManagerInterface
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)

#: Without a status message for this time the task manager counts as down (s of wall time). It publishes at 5 Hz.
STATUS_TIMEOUT = 2.0
#: The status of goals that have not ended.
_ACTIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)


class TaskManagerConnection:
    """Watches the task manager `tm` in this node's namespace and sends it goals.

    :param on_progress: called with each message of a goal, in ROS threads.
    :param report: called with each new status of the connection, in any thread; must not block.
    """

    def __init__(self, on_progress: Callable[[GoalProgress], None], report: Callable[[Connection], None]) -> None:
        name = rospy.resolve_name(ACHIEVE_ACTION).rpartition("/")[0]
        self.connection = Connection(TASK_MANAGER, name, False, 0.0)
        self._connection_lock = threading.Lock()
        self._report = report
        report(self.connection)
        self._last_status = -STATUS_TIMEOUT
        self.active_goals: frozenset[str] = frozenset()
        self._client: TaskManagerInterface | None = None
        self._goal_lock = threading.Lock()
        self._cancel: Any = None
        self._topics = GoalTopics(on_progress, self._on_status)

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
                raise TimedOut(f"the task manager {self.connection.address} does not answer")
            time.sleep(0.01)

    def check(self) -> None:
        """Detects that it is down. To be called periodically."""
        is_silent = time.monotonic() - self._last_status > STATUS_TIMEOUT
        if self.connection.is_up and (is_silent or not self._topics.is_connected):
            self._set(False)

    def close(self) -> None:
        """Disconnects."""
        self._topics.close()

    def _on_status(self, message: Any) -> None:
        self.active_goals = frozenset(each.goal_id.id for each in message.status_list if each.status in _ACTIVE)
        self._last_status = time.monotonic()
        self._set(True)

    def _set(self, is_up: bool) -> None:
        with self._connection_lock:
            if is_up != self.connection.is_up:
                self.connection = self.connection.updated(is_up)
                self._report(self.connection)  # under the lock: in order


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
