"""The client of a manager's action `execute`: each goal runs skills as a task."""

from __future__ import annotations

import json
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from skiros2_common.core.errors import TimedOut
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.params import Param
from skiros2_common.ros import utils
from skiros2_common.ros.connections import ServerWatch
from skiros2_msgs import msg as msgs

#: A manager without a message for this time counts as dead (s); it sends five a second.
SILENCE = 5.0

#: The time that a manager has to accept a goal when it is its turn (s): with hundreds of tasks on a busy machine, it
#: takes seconds.
ACCEPT_TIMEOUT = 30.0

#: Queue size for goals, cancellations and results.
QUEUE_SIZE = 10_000

_CONNECT_POLL_PERIOD = 0.01  # s
_ALIVE_CHECK_PERIOD = 0.5  # s


@dataclass
class _LastAccepted:
    """The goal of a client that the manager has accepted last: when it was sent and accepted (s, monotonic).

    A manager accepts goals in the order in which they were sent: a burst may take a while.
    """

    sent_at: float = 0.0
    accepted_at: float = 0.0


class SkillGoal:
    """A goal: skills that are running, have ended, or were refused. Any thread.

    :param client: sends the goal.
    :param monitor_cb: see `SkillRunner.run`.
    :param last_accepted: shared by all goals of the client.
    :param goal_id: of the goal; None: a new one.
    """

    def __init__(
        self,
        client: actionlib.ActionClient,
        goal: Any,
        monitor_cb: Callable[[Any], None] | None,
        last_accepted: _LastAccepted,
        goal_id: GoalID | None = None,
    ) -> None:
        self._watch = ServerWatch(client)
        self._last_accepted = last_accepted
        self._monitor_cb = monitor_cb
        self._ended = threading.Event()
        self._begun = threading.Event()
        self._known = threading.Event()
        self._task = -1
        self._result: Any = None
        self._was_accepted = False
        self._sent_at = time.monotonic()
        if goal_id is not None:
            client.manager._generate_id = lambda: goal_id  # actionlib has no other way to choose it
        try:
            self._handle = client.send_goal(goal, self._on_transition)
        finally:
            client.manager.__dict__.pop("_generate_id", None)

    @property
    def goal_id(self) -> str:
        """The id of the goal in messages."""
        return str(self._handle.comm_state_machine.action_goal.goal_id.id)

    @property
    def task(self) -> int:
        """The id of the task; -1 before it is known, and when it was refused."""
        return self._task

    @property
    def done(self) -> bool:
        """Whether the skills have ended or were refused."""
        return self._ended.is_set()

    def wait_until_known(self, timeout: float | None = None) -> bool:
        """Waits until the manager has answered. Returns whether it has the skills: they run or have ended.

        :raises TimedOut: the manager has died, or has not answered in time.
        """
        if not self._wait(self._known, timeout):
            raise TimedOut(f"{self._watch.name} has not answered within {timeout:g} s")
        return not (self.done and self._handle.get_goal_status() == GoalStatus.REJECTED)

    def cancel(self) -> None:
        """Requests the preemption of these skills. Returns at once."""
        self._handle.cancel()

    def wait(self, timeout: float | None = None) -> bool:
        """Waits for the end. Returns `done`.

        :param timeout: s; None: as long as the manager lives.
        :raises TimedOut: the manager has died, or has not received the goal.
        """
        return self._wait(self._ended, timeout)

    def wait_for_task(self, timeout: float | None = None) -> int:
        """Waits until the skills run. Returns the task id; -1 when they were refused, or after a timeout.

        :param timeout: s; None: as long as the manager lives.
        :raises TimedOut: the manager has died, or has not received the goal.
        """
        self._wait(self._begun, timeout)
        return self._task

    def result(self, timeout: float | None = None) -> Any:
        """Waits for the end. Returns the `ExecuteSkillsResult`.

        :param timeout: s; None: as long as the manager lives.
        :raises TimedOut: the skills have not ended in time, or the manager has died.
        """
        if not self.wait(timeout):
            raise TimedOut(f"{self._watch.name}: no result within {timeout:g} s")
        return self._result

    def succeeded(self, timeout: float | None = None) -> bool:
        """Waits for the end. Returns whether the skills have succeeded. Raises like `result`."""
        return bool(self.result(timeout).state == msgs.SkillProgress.SUCCESS)

    def params(self, timeout: float | None = None) -> dict[str, Param]:
        """Waits for the end. Returns the final parameters by key. Raises like `result`."""
        return utils.deserializeParamMap(self.result(timeout).params)

    def explanations(self, timeout: float | None = None) -> list[Explanation]:
        """Waits for the end. Returns why nodes failed, the last failure at the end. Raises like `result`."""
        return [Explanation.from_dict(data) for data in json.loads(self.result(timeout).explanation or "[]")]

    def _wait(self, event: threading.Event, timeout: float | None) -> bool:
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            period = _ALIVE_CHECK_PERIOD
            if event.wait(period if deadline is None else max(0.0, min(period, deadline - time.monotonic()))):
                return True
            if self._watch.time_since_status() > SILENCE:
                raise TimedOut(f"{self._watch.name} sent no status for {SILENCE:g} s")
            if self._is_unknown() and self._unaccepted_time() > ACCEPT_TIMEOUT:
                raise TimedOut(f"{self._watch.name} did not accept the goal")
            if self._watch.time_without_result(self._handle) > SILENCE:
                raise TimedOut(f"{self._watch.name}: the skills have ended, but their result was lost")
            if deadline is not None and time.monotonic() >= deadline:
                return False

    def _unaccepted_time(self) -> float:
        """How long the manager has not accepted the goal since it was its turn (s)."""
        last = self._last_accepted
        turn = last.accepted_at if last.sent_at < self._sent_at else 0.0
        return time.monotonic() - max(self._sent_at, turn)

    def _is_unknown(self) -> bool:
        """Whether the manager lacks the goal, according to a status message that is late enough."""
        is_waiting = self._handle.get_comm_state() == actionlib.CommState.WAITING_FOR_GOAL_ACK
        return bool(is_waiting and self._watch.status_is_later(time.monotonic() - self._sent_at, SILENCE))

    # Called by threads of ROS.

    def on_feedback(self, feedback: Any) -> None:
        """Handles feedback, which may arrive after the result."""
        self._task = feedback.task_id
        self._begun.set()
        if self._monitor_cb is not None:
            self._monitor_cb(feedback)

    def _on_transition(self, handle: Any) -> None:
        if not self._was_accepted:
            self._was_accepted = True
            self._last_accepted.sent_at, self._last_accepted.accepted_at = self._sent_at, time.monotonic()
        if handle.get_comm_state() in (actionlib.CommState.ACTIVE, actionlib.CommState.PREEMPTING):
            self._known.set()
        if handle.get_comm_state() != actionlib.CommState.DONE:
            return
        result = handle.get_result()
        if result is None:  # the goal is lost
            text = "the manager no longer knows these skills: it was restarted"
            result = msgs.ExecuteSkillsResult(self._task, msgs.SkillProgress.FAILURE, -1, text, [], "[]")
        self._result = result
        self._task = result.task_id
        self._ended.set()
        self._begun.set()
        self._known.set()


class SkillRunner:
    """The client of a manager's action. Any thread.

    :param manager_name: the manager's node name.
    """

    def __init__(self, manager_name: str) -> None:
        self._client = actionlib.ActionClient(f"{manager_name}/execute", msgs.ExecuteSkillsAction)
        # Set before anything connects: actionlib's default of 10 drops goals that are sent in a burst.
        self._client.pub_goal.impl.set_queue_size(QUEUE_SIZE)
        self._client.pub_cancel.impl.set_queue_size(QUEUE_SIZE)
        self._watch = ServerWatch(self._client)
        self._lock = threading.Lock()  # actionlib gives two threads the same goal id
        self._last_accepted = _LastAccepted()
        self._runs: weakref.WeakValueDictionary[str, SkillGoal] = weakref.WeakValueDictionary()
        # In addition to actionlib's own, which drops feedback that arrives after the result.
        topic = self._client.feedback_sub
        self._subscriber = rospy.Subscriber(topic.resolved_name, topic.data_class, self._on_feedback)

    def run(
        self,
        author: str,
        skills: Sequence[Any],
        monitor_cb: Callable[[Any], None] | None = None,
        connect_timeout: float = 5.0,
        goal_id: str = "",
        goal: str = "",
    ) -> SkillGoal:
        """Sends a goal.

        :param skills: as `ResourceDescription`.
        :param monitor_cb: called, in a thread of ROS, with each `ExecuteSkillsFeedback`.
        :param connect_timeout: s to wait for the manager.
        :param goal_id: with which another process can `attach` to the skills; "": a new one.
        :param goal: of the task manager, of which the skills are a step; "": none.
        :raises TimedOut: no manager answers.
        """
        chosen = GoalID(rospy.Time.now(), goal_id) if goal_id else None
        return self._send(msgs.ExecuteSkillsGoal(author, list(skills), goal), monitor_cb, connect_timeout, chosen)

    def attach(self, author: str, goal_id: str, connect_timeout: float = 5.0) -> SkillGoal:
        """Follows skills that another process has started; see `SkillGoal.wait_until_known`.

        :raises TimedOut: no manager answers.
        """
        return self._send(msgs.ExecuteSkillsGoal(author=author), None, connect_timeout, GoalID(id=goal_id))

    def _send(
        self, goal: Any, monitor_cb: Callable[[Any], None] | None, connect_timeout: float, goal_id: GoalID | None
    ) -> SkillGoal:
        deadline = time.monotonic() + connect_timeout
        while not self._watch.is_connected():
            if time.monotonic() > deadline:
                raise TimedOut(f"{self._watch.name}: no manager answers within {connect_timeout:g} s")
            time.sleep(_CONNECT_POLL_PERIOD)
        with self._lock:
            run = SkillGoal(self._client, goal, monitor_cb, self._last_accepted, goal_id)
            self._runs[run.goal_id] = run
        return run

    def close(self) -> None:
        """Stops sending goals and receiving feedback."""
        self._client.stop()
        self._subscriber.unregister()

    def _on_feedback(self, message: Any) -> None:
        with self._lock:
            run = self._runs.get(message.status.goal_id.id)
        if run is not None:
            run.on_feedback(message.feedback)
