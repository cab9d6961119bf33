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
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

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

#: The default of the parameter `actionlib_status_frequency` (status messages per second).
_STATUS_FREQUENCY = 5.0


class _StatusTimer:
    """Publishes the status of an action server by the wall clock.

    :param period: s; None: never.
    """

    def __init__(self, server: Any, period: float | None) -> None:
        self._server = server
        self._period = period
        self._ended = threading.Event()
        threading.Thread(target=self._run, name=f"{server.ns} status", daemon=True).start()

    def shutdown(self) -> None:
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.wait(self._period):
            self._server.publish_status_async(None)


class _ActionServer(actionlib.ActionServer):  # type: ignore[misc]
    """actionlib's server with a status by the wall clock: its own timer ends when a simulated clock is reset."""

    def initialize(self) -> None:
        name, queue_size = rospy.remap_name(self.ns), rospy.get_param("actionlib_server_sub_queue_size", -1)
        received = queue_size if queue_size >= 0 else None
        self.status_pub = rospy.Publisher(f"{name}/status", GoalStatusArray, latch=True, queue_size=50)
        self.result_pub = rospy.Publisher(f"{name}/result", self.ActionResult, queue_size=_QUEUE_SIZE)
        self.feedback_pub = rospy.Publisher(f"{name}/feedback", self.ActionFeedback, queue_size=_QUEUE_SIZE)
        self.goal_sub = rospy.Subscriber(
            f"{name}/goal", self.ActionGoal, self.internal_goal_callback, queue_size=received
        )
        self.cancel_sub = rospy.Subscriber(
            f"{name}/cancel", GoalID, self.internal_cancel_callback, queue_size=received
        )
        self.status_list_timeout = rospy.Duration(rospy.get_param(f"{name}/status_list_timeout", 5.0))
        parameter = rospy.search_param("actionlib_status_frequency")
        frequency = rospy.get_param(parameter) if parameter else _STATUS_FREQUENCY
        self.status_timer = _StatusTimer(self, 1.0 / frequency if frequency > 0.0 else None)


class GoalServer:
    """Handles goals in their order, and cancellations beside them: these never wait for a goal to begin. Subclasses
    define how.

    actionlib calls back with a lock held that other threads need to publish feedback and results, so the callbacks only
    queue the request. The status is published by the wall clock, so that clients do not lose the server while a
    simulation is paused or restarts its clock.

    :param name: of the action, `~name` for a private one.
    :param spec: the action's class.
    :param status_kept: how long the status lists a goal that has ended, at least (s).
    :param delay: from the receipt of a goal to its start (s). actionlib's simple client logs an error, and may miss the
        goal's end, if the goal changes its state before the client's `send_goal` has returned.
    """

    def __init__(self, name: str, spec: Any, status_kept: float = 0.0, delay: float = 0.0) -> None:
        self._name = name
        self._status_kept = status_kept
        #: With the earliest start of each (s, monotonic).
        self._goals_waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._cancellations: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._thread = threading.Thread(
            target=self._serve, args=(self._goals_waiting, self._take), name=name.strip("~/"), daemon=True
        )
        self._server = _ActionServer(
            name,
            spec,
            lambda handle: self._goals_waiting.put((handle, time.monotonic() + delay)),
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
        self._server.stop()

    # -- in the threads of the action ----------------------------------------------------------------------------

    def _serve(self, handles: queue.SimpleQueue[Any], act: Callable[[Any], None]) -> None:
        while (handle := handles.get()) is not None:
            try:
                act(handle)
            except Exception:
                log.exception("action %s: a request raised an error", self._name)

    def _take(self, waiting: tuple[Any, float]) -> None:
        handle, earliest = waiting
        time.sleep(max(0.0, earliest - time.monotonic()))
        if handle.get_goal_status().status == GoalStatus.RECALLING:
            message = "cancelled before its start"
            handle.set_canceled(self._unserved_result(True, message), message)
        else:
            self._begin(handle)

    # -- the end -------------------------------------------------------------------------------------------------

    def _waiting(self) -> Iterable[Any]:
        while not self._goals_waiting.empty():
            if (waiting := self._goals_waiting.get()) is not None:
                yield waiting[0]

    def _flush(self) -> None:
        # rospy writes in its own threads and drops queued messages when a topic is closed.
        deadline = time.monotonic() + _FLUSH_TIMEOUT
        connections = self._server.result_pub.impl.connections
        while any(getattr(c, "_queue", None) for c in connections) and time.monotonic() < deadline:
            time.sleep(0.005)
        time.sleep(0.01)  # the last message taken from the queue is being written
