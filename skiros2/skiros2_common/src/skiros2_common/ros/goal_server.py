"""An action server that handles goals in one thread of its own, and cancellations in another."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Any

import actionlib
import rospy
from actionlib.handle_tracker_deleter import HandleTrackerDeleter
from actionlib.server_goal_handle import ServerGoalHandle
from actionlib.status_tracker import StatusTracker
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
    """actionlib's server with times of the monotonic clock.

    Its own timer of the status ends when a simulated clock is reset, and goals that have ended leave its own list at
    once, or only days later, when the wall clock is set.
    """

    def initialize(self) -> None:
        name, queue_size = rospy.remap_name(self.ns), rospy.get_param("actionlib_server_sub_queue_size", -1)
        received = queue_size if queue_size >= 0 else None
        self.status_pub = rospy.Publisher(f"{name}/status", GoalStatusArray, latch=True, queue_size=50)
        self.result_pub = rospy.Publisher(f"{name}/result", self.ActionResult, queue_size=_QUEUE_SIZE)
        self.feedback_pub = rospy.Publisher(f"{name}/feedback", self.ActionFeedback, queue_size=_QUEUE_SIZE)
        self.goal_sub = rospy.Subscriber(
            f"{name}/goal", self.ActionGoal, self.internal_goal_callback, queue_size=received
        )
        self.cancel_sub = rospy.Subscriber(f"{name}/cancel", GoalID, self.internal_cancel_callback, queue_size=received)
        self.status_list_timeout = rospy.Duration(rospy.get_param(f"{name}/status_list_timeout", 5.0))
        parameter = rospy.search_param("actionlib_status_frequency")
        frequency = rospy.get_param(parameter) if parameter else _STATUS_FREQUENCY
        self._ended: dict[int, tuple[Any, float]] = {}  # trackers of ended goals, and when they were seen to have ended
        self.status_timer = _StatusTimer(self, 1.0 / frequency if frequency > 0.0 else None)

    def publish_status(self) -> None:
        now, timeout = time.monotonic(), self.status_list_timeout.to_sec()
        with self.lock:
            known, self._ended = self._ended, {}
            for tracker in self.status_list:
                if tracker.handle_destruction_time != rospy.Time():
                    self._ended[id(tracker)] = known.get(id(tracker), (tracker, now))
            expired = {key for key, (_, ended) in self._ended.items() if now - ended > timeout}
            self.status_list[:] = [tracker for tracker in self.status_list if id(tracker) not in expired]
            message = GoalStatusArray(status_list=[tracker.status for tracker in self.status_list])
            message.header.stamp = rospy.Time.now()
            if not rospy.is_shutdown():
                self.status_pub.publish(message)


class _KeepingServer(_ActionServer):
    """Keeps results, and sends them to clients that were restarted, or that connect again after its own restart.

    A goal without content and with the time stamp 0 is a question for the goal with its id: the server publishes the
    result if the goal has ended, calls `repeat` if it has not, and rejects a goal that it does not know. The stamp in
    an answer of the last kind is 0 as well.

    :param is_empty: whether a goal has no content.
    :param repeat: called if a goal that has not ended is sent again.
    :param unknown: returns the result of a question for an unknown goal, by its text.
    """

    def __init__(
        self,
        name: str,
        spec: Any,
        goal_cb: Callable[[Any], None],
        cancel_cb: Callable[[Any], None],
        results_kept: int,
        is_empty: Callable[[Any], bool],
        repeat: Callable[[str], None],
        unknown: Callable[[str], Any],
    ) -> None:
        super().__init__(name, spec, goal_cb, cancel_cb, auto_start=False)
        self._results_kept = results_kept
        self._is_empty = is_empty
        self._repeat = repeat
        self._unknown = unknown
        self._results: OrderedDict[str, tuple[Any, Any]] = OrderedDict()  # status and result
        self._undelivered: list[str] = []
        #: In answers for unknown goals: REJECTED, or LOST if an earlier process may have known the goal.
        self.unknown_status = GoalStatus.REJECTED

    def initialize(self) -> None:
        super().initialize()
        self.result_pub.impl.add_subscriber_listener(self)

    def peer_subscribe(self, topic: str, publish: Any, publish_to_peer: Callable[[Any], None]) -> None:
        """Called by rospy: sends a new subscriber the results that it may have missed."""
        for goal_id in self._undelivered:
            publish_to_peer(self._message(*self._results[goal_id]))

    def peer_unsubscribe(self, topic: str, count: int) -> None:
        """Called by rospy."""

    def keep(self, status: Any, result: Any, delivered: bool = True) -> None:
        """Keeps a result.

        :param delivered: False: clients that connect from now on get it.
        """
        with self.lock:
            self._results[status.goal_id.id] = (status, result)
            if not delivered:
                self._undelivered.append(status.goal_id.id)
            while len(self._results) > self._results_kept:
                old, _ = self._results.popitem(last=False)
                if old in self._undelivered:
                    self._undelivered.remove(old)

    def publish_result(self, status: Any, result: Any) -> None:
        with self.lock:
            self.keep(status, result)
            super().publish_result(status, result)

    def internal_goal_callback(self, goal: Any) -> None:
        with self.lock:
            goal_id = goal.goal_id.id
            if not self.started:
                return
            if goal_id in self._results:
                self.result_pub.publish(self._message(*self._results[goal_id]))
            elif any(tracker.status.goal_id.id == goal_id for tracker in self.status_list):
                super().internal_goal_callback(goal)  # a cancellation may have come first
                self._repeat(goal_id)
            elif goal.goal_id.stamp.is_zero() and goal_id and self._is_empty(goal.goal):
                text = f"{rospy.get_name()} does not know the goal {goal_id}"
                status = GoalStatus(goal.goal_id, self.unknown_status, text)
                self.result_pub.publish(self._message(status, self._unknown(text) or self.ActionResultType()))
            else:
                super().internal_goal_callback(goal)

    def _message(self, status: Any, result: Any) -> Any:
        message = self.ActionResult(status=status, result=result)
        message.header.stamp = rospy.Time.now()
        return message


class GoalServer:
    """Handles goals in their order, and cancellations beside them: these never wait for a goal to begin. Subclasses
    define how.

    actionlib calls back with a lock held that other threads need to publish feedback and results, so the callbacks only
    queue the request. The status is published by the wall clock, so that clients do not lose the server while a
    simulation is paused or restarts its clock.

    A goal is executed once, also if it is sent again. A client that was restarted finds its goal with a question: a
    goal with the same id, the time stamp 0 and no content. See `_KeepingServer`.

    :param name: of the action, `~name` for a private one.
    :param spec: the action's class.
    :param status_kept: how long the status lists a goal that has ended, at least (s).
    :param delay: from the receipt of a goal to its start (s). actionlib's simple client logs an error, and may miss the
        goal's end, if the goal changes its state before the client's `send_goal` has returned.
    :param results_kept: the number of the last results that are kept for questions.
    """

    def __init__(
        self, name: str, spec: Any, status_kept: float = 0.0, delay: float = 0.0, results_kept: int = 0
    ) -> None:
        self._name = name
        self._status_kept = status_kept
        #: With the earliest start of each (s, monotonic).
        self._goals_waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._cancellations: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._thread = threading.Thread(
            target=self._serve, args=(self._goals_waiting, self._take), name=name.strip("~/"), daemon=True
        )
        self._server = _KeepingServer(
            name,
            spec,
            lambda handle: self._goals_waiting.put((handle, time.monotonic() + delay)),
            self._cancellations.put,
            results_kept,
            self._is_empty,
            self._repeat,
            lambda text: self._unserved_result(False, text),
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

    def _repeat(self, goal_id: str) -> None:
        """Publishes feedback on a goal that has not ended: its client has missed some. Called in a ROS thread."""

    def _is_empty(self, goal: Any) -> bool:
        """Whether a goal has no content, so that it may be a question. Called in a ROS thread."""
        return False

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

    def restore(self, action_goal: Any, text: str) -> Any:
        """Lists a goal that an earlier process has accepted. Returns its handle. To be called before `start`.

        :param action_goal: its message.
        :param text: of its status.
        """
        tracker = StatusTracker(None, None, action_goal)
        tracker.status.status, tracker.status.text = GoalStatus.ACTIVE, text
        tracker.handle_tracker = HandleTrackerDeleter(self._server, tracker)
        self._server.status_list.append(tracker)
        return ServerGoalHandle(tracker, self._server, tracker.handle_tracker)

    def restore_result(self, status: Any, result: Any, delivered: bool) -> None:
        """Keeps a result of an earlier process. To be called before `start`.

        :param delivered: False: clients may have missed it, and get it when they connect.
        """
        self._server.keep(status, result, delivered)
        if not delivered:
            tracker = StatusTracker(status.goal_id, status.status)
            tracker.status.text, tracker.handle_destruction_time = status.text, rospy.Time.now()
            self._server.status_list.append(tracker)

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
