"""An action server that handles goals in one thread of its own, and cancellations in another."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus

log = logging.getLogger(__name__)


def is_cancelled(handle: Any) -> bool:
    """Whether the client has cancelled an accepted goal that has not ended."""
    return bool(handle.get_goal_status().status == GoalStatus.PREEMPTING)


#: States of goals that have not ended.
ACTIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)

#: The queue size of results and feedback; actionlib's own 50 are too few if many goals end at once.
_QUEUE_SIZE = 10_000

#: The timeout for writing the last results to the sockets (s of wall time).
_FLUSH_TIMEOUT = 0.5

#: The period of status messages where the simulated clock may be paused (s of wall time).
_STATUS_PERIOD = 0.2


class GoalServer:
    """Handles goals in their order, and cancellations beside them: these never wait for a goal to begin. Subclasses
    define how.

    actionlib calls back with a lock held that other threads need to publish feedback and results, so the callbacks only
    queue the request. actionlib publishes the status by the ROS clock; if that is simulated, this class publishes it by
    the wall clock, so that clients do not lose the server while the simulation is paused or restarts its clock.

    :param name: of the action, `~name` for a private one.
    :param spec: the action's class.
    :param status_kept: how long the status lists a goal that has ended, at least (s).
    """

    def __init__(self, name: str, spec: Any, status_kept: float = 0.0) -> None:
        self._name = name
        self._status_kept = status_kept
        self._goals_waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._cancellations: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._thread = threading.Thread(
            target=self._serve, args=(self._goals_waiting, self._take), name=name.strip("~/"), daemon=True
        )
        self._server = actionlib.ActionServer(
            name,
            spec,
            self._goals_waiting.put,
            self._cancellations.put,
            auto_start=False,
        )

    # -- to override -----------------------------------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        """Accepts or rejects a goal that was not cancelled before; in the thread of the goals.

        A goal that is cancelled before `_cancel` can find it `is_cancelled` afterwards.
        """
        raise NotImplementedError

    def _cancel(self, handle: Any) -> None:
        """Preempts a goal, if it is still active; in the thread of the cancellations."""
        raise NotImplementedError

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        """The result of a goal that was not executed, or not to its end."""
        return None

    def _unfinished_handles(self) -> Iterable[Any]:
        """The handles of accepted goals that may lack a result. Called last by `close`."""
        raise NotImplementedError

    # -- any thread ----------------------------------------------------------------------------------------------

    @property
    def has_subscribers(self) -> bool:
        """Whether feedback has subscribers."""
        return bool(self._server.feedback_pub.get_num_connections() > 0)

    def start(self) -> None:
        """Starts to accept goals."""
        self._thread.start()
        threading.Thread(
            target=self._serve, args=(self._cancellations, self._cancel), name=f"{self._thread.name} stop", daemon=True
        ).start()
        self._server.start()
        self._server.status_list_timeout = max(self._server.status_list_timeout, rospy.Duration(self._status_kept))
        if not rospy.rostime.is_wallclock():
            self._server.status_timer.shutdown()
            threading.Thread(target=self._publish_status, name=f"{self._thread.name} status", daemon=True).start()
        # Before the first connection.
        self._server.result_pub.impl.set_queue_size(_QUEUE_SIZE)
        self._server.feedback_pub.impl.set_queue_size(_QUEUE_SIZE)

    def close(self, timeout: float = 1.0) -> None:
        """Stops accepting goals, aborts or rejects the remaining ones, and waits until the results are sent.

        :param timeout: s to wait at most for the current request.
        """
        if self._thread.ident is None:
            return  # never started
        self._goals_waiting.put(None)
        self._cancellations.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)
        message = f"{rospy.get_name()} ended before the goal did"
        result = self._unserved_result(False, message)
        for handle in self._unfinished_handles():
            if handle.get_goal_status().status in ACTIVE:
                handle.set_aborted(result, message)
        for handle in self._waiting():
            handle.set_rejected(result, message)
        self._flush()
        self._closed.set()
        self._server.stop()

    # -- in the threads of the action ----------------------------------------------------------------------------

    def _serve(self, handles: queue.SimpleQueue[Any], act: Callable[[Any], None]) -> None:
        while (handle := handles.get()) is not None:
            try:
                act(handle)
            except Exception:
                log.exception("action %s: a request raised an error", self._name)

    def _take(self, handle: Any) -> None:
        if handle.get_goal_status().status == GoalStatus.RECALLING:
            message = "cancelled before its start"
            handle.set_canceled(self._unserved_result(True, message), message)
        else:
            self._begin(handle)

    def _publish_status(self) -> None:
        while not self._closed.wait(_STATUS_PERIOD):
            self._server.publish_status_async(None)

    # -- the end -------------------------------------------------------------------------------------------------

    def _waiting(self) -> Iterable[Any]:
        while not self._goals_waiting.empty():
            if (handle := self._goals_waiting.get()) is not None:
                yield handle

    def _flush(self) -> None:
        # rospy writes in its own threads and drops queued messages when a topic is closed.
        deadline = time.monotonic() + _FLUSH_TIMEOUT
        connections = self._server.result_pub.impl.connections
        while any(getattr(c, "_queue", None) for c in connections) and time.monotonic() < deadline:
            time.sleep(0.005)
        time.sleep(0.01)  # the last message taken from the queue is being written
