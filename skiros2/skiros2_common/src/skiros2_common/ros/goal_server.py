"""An action server whose goals and cancellations are taken by a thread of its own."""

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

#: States of goals that have not ended.
ACTIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)

#: So many feedbacks may wait to be sent; those of large trees are large.
_MOST_FEEDBACK = 1000

#: How long the last results have to reach the sockets (s of wall time).
_SENDING_SECONDS = 0.5

#: How often the status is told where the simulated clock may stand still (s of wall time).
_STATUS_PERIOD = 0.2


class GoalServer:
    """Takes goals and cancellations in their order. Subclasses say what becomes of them.

    actionlib calls with a lock held that other threads need to give feedback and results, so nothing is done in its
    calls. actionlib tells the status by the ROS clock; where that is simulated it is told by the wall clock here: so
    clients do not take a server for lost when the world is paused or its clock begins anew.

    :param name: of the action, `~name` for a private one.
    :param spec: the action's class.
    :param most_results: so many may wait to be sent. actionlib's own 50 are too few where many goals end at once.
    """

    def __init__(self, name: str, spec: Any, most_results: int = 1000) -> None:
        self._name = name
        self._most_results = most_results
        self._requests: queue.SimpleQueue[tuple[Callable[[Any], None], Any] | None] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=name.strip("~/"), daemon=True)
        self._server = actionlib.ActionServer(
            name,
            spec,
            lambda handle: self._requests.put((self._take, handle)),
            lambda handle: self._requests.put((self._cancel, handle)),
            auto_start=False,
        )

    # -- what subclasses say, in the thread of the action --------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        """Accepts or rejects a goal. Called for goals that were not cancelled before."""
        raise NotImplementedError

    def _cancel(self, handle: Any) -> None:
        """Ends a goal before its time, if it is still carried out."""
        raise NotImplementedError

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        """The result for a goal that was not carried out, or not to its end."""
        return None

    def _left(self) -> Iterable[Any]:
        """The handles of goals that were begun and perhaps have no result yet. Called by `close`, last."""
        raise NotImplementedError

    # -- any thread ----------------------------------------------------------------------------------------------

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody would hear feedback."""
        return bool(self._server.feedback_pub.get_num_connections() > 0)

    def start(self) -> None:
        """Takes goals from now on."""
        self._thread.start()
        self._server.start()
        if not rospy.rostime.is_wallclock():
            self._server.status_timer.shutdown()
            threading.Thread(target=self._tell_status, name=f"{self._thread.name} status", daemon=True).start()
        # Before anybody is connected.
        self._server.result_pub.impl.set_queue_size(self._most_results)
        self._server.feedback_pub.impl.set_queue_size(_MOST_FEEDBACK)

    def close(self, timeout: float = 1.0) -> None:
        """Takes no more goals, answers those that are left, and ends when the answers were sent.

        :param timeout: s to wait at most for a request that is being served.
        """
        if self._thread.ident is None:
            return  # never started
        self._requests.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)
        message = f"{rospy.get_name()} ended before the goal did"
        result = self._unserved_result(False, message)
        for handle in self._left():
            if handle.get_goal_status().status in ACTIVE:
                handle.set_aborted(result, message)
        for act, handle in self._waiting():
            if act == self._take:
                handle.set_rejected(result, message)
        self._flush()
        self._closed.set()
        self._server.stop()

    # -- in the thread of the action -----------------------------------------------------------------------------

    def _serve(self) -> None:
        while (request := self._requests.get()) is not None:
            act, handle = request
            try:
                act(handle)
            except Exception:
                log.exception("a request to %s", self._name)

    def _take(self, handle: Any) -> None:
        if handle.get_goal_status().status == GoalStatus.RECALLING:
            message = "cancelled before it was begun"
            handle.set_canceled(self._unserved_result(True, message), message)
        else:
            self._begin(handle)

    def _tell_status(self) -> None:
        while not self._closed.wait(_STATUS_PERIOD):
            self._server.publish_status_async(None)

    # -- the end -------------------------------------------------------------------------------------------------

    def _waiting(self) -> Iterable[tuple[Callable[[Any], None], Any]]:
        while not self._requests.empty():
            if (request := self._requests.get()) is not None:
                yield request

    def _flush(self) -> None:
        # rospy writes in threads of its own, and drops what they have not begun to write when a topic is closed.
        end = time.monotonic() + _SENDING_SECONDS
        connections = self._server.result_pub.impl.connections
        while any(getattr(c, "_queue", None) for c in connections) and time.monotonic() < end:
            time.sleep(0.005)
        time.sleep(0.01)  # what was taken from the queue last is being written
