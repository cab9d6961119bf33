"""Skills that a client has asked a manager to run, as goals of its action."""

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

from skiros2_common.core.errors import TimedOut
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.params import Param
from skiros2_common.ros import utils
from skiros2_common.ros.action_server_watch import ServerWatch
from skiros2_msgs import msg as msgs

#: A manager that says nothing for so long counts as dead (s); it says something five times a second.
SILENCE = 5.0

#: So many goals, cancellations or results may wait to be sent.
MOST_AT_ONCE = 10_000

_POLL = 0.01  # s, while the connection is made
_LOOK = 0.5  # s, between two looks whether the manager is alive


@dataclass
class _Taken:
    """The goal of a client that the manager has taken last: when it was sent, and taken (s, monotonic).

    A manager takes goals one after the other, in the order in which they were sent: many at once may take a while.
    """

    sent_at: float = 0.0
    taken_at: float = 0.0


class SkillRun:
    """A goal: skills that run, have run, or were refused. Any thread.

    :param client: what it is sent with.
    :param taken: shared by all goals of the client.
    """

    def __init__(
        self, client: actionlib.ActionClient, goal: Any, monitor_cb: Callable[[Any], None] | None, taken: _Taken
    ) -> None:
        self._watch = ServerWatch(client)
        self._taken = taken
        self._monitor_cb = monitor_cb
        self._ended = threading.Event()
        self._begun = threading.Event()
        self._task = -1
        self._result: Any = None
        self._was_taken = False
        self._sent_at = time.monotonic()
        self._handle = client.send_goal(goal, self._on_transition)

    @property
    def goal_id(self) -> str:
        """By which feedback speaks of it."""
        return str(self._handle.comm_state_machine.action_goal.goal_id.id)

    @property
    def task(self) -> int:
        """The id of the task, -1 while it is not known and when it was refused."""
        return self._task

    @property
    def done(self) -> bool:
        """Whether the skills have ended or were refused."""
        return self._ended.is_set()

    def cancel(self) -> None:
        """Asks the manager to end these skills, and no others. Returns at once."""
        self._handle.cancel()

    def wait(self, timeout: float | None = None) -> bool:
        """Waits for the end. Returns `done`.

        :param timeout: s; None: as long as the manager lives.
        :raises TimedOut: the manager is not there any more, or has not got the skills.
        """
        return self._wait(self._ended, timeout)

    def wait_for_task(self, timeout: float | None = None) -> int:
        """Waits until the skills run. Returns the id of the task; -1 when they were refused, or in time do not run.

        :raises TimedOut: the manager is not there any more, or has not got the skills.
        """
        self._wait(self._begun, timeout)
        return self._task

    def result(self, timeout: float | None = None) -> Any:
        """Waits for the end. Returns the `ExecuteSkillsResult`.

        :param timeout: s; None: as long as the manager lives.
        :raises TimedOut: the end did not come in time, or the manager is not there any more.
        """
        if not self.wait(timeout):
            raise TimedOut(f"{self._watch.name}: no result within {timeout:g} s")
        return self._result

    def succeeded(self, timeout: float | None = None) -> bool:
        """Waits for the end. Returns whether the skills have succeeded; raises as `result`."""
        return bool(self.result(timeout).state == msgs.SkillProgress.SUCCESS)

    def params(self, timeout: float | None = None) -> dict[str, Param]:
        """Waits for the end. Returns the parameters by key as they were then; raises as `result`."""
        return utils.deserializeParamMap(self.result(timeout).params)

    def explanations(self, timeout: float | None = None) -> list[Explanation]:
        """Waits for the end. Returns why nodes failed, the one that failed last at the end; raises as `result`."""
        return [Explanation.from_dict(data) for data in json.loads(self.result(timeout).explanation or "[]")]

    def _wait(self, event: threading.Event, timeout: float | None) -> bool:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = _LOOK if end is None else min(_LOOK, end - time.monotonic())
            if event.wait(max(0.0, left)):
                return True
            if self._watch.time_since_status() > SILENCE:
                raise TimedOut(f"{self._watch.name} has said nothing for {SILENCE:g} s")
            if self._is_unknown() and self._untaken() > SILENCE:
                raise TimedOut(f"{self._watch.name} has not taken the skills")
            if self._watch.time_without_result(self._handle) > SILENCE:
                raise TimedOut(f"{self._watch.name}: the skills have ended, but their result was lost")
            if end is not None and time.monotonic() >= end:
                return False

    def _untaken(self) -> float:
        """For how long the manager could have taken the goal and has not (s)."""
        taken = self._taken
        turn = taken.taken_at if taken.sent_at < self._sent_at else 0.0
        return time.monotonic() - max(self._sent_at, turn)

    def _is_unknown(self) -> bool:
        return bool(self._handle.get_comm_state() == actionlib.CommState.WAITING_FOR_GOAL_ACK)

    # Called by threads of ROS.

    def on_feedback(self, feedback: Any) -> None:
        """Something is new; the last of it may come after the result."""
        self._task = feedback.task_id
        self._begun.set()
        if self._monitor_cb is not None:
            self._monitor_cb(feedback)

    def _on_transition(self, handle: Any) -> None:
        if not self._was_taken:
            self._was_taken = True
            self._taken.sent_at, self._taken.taken_at = self._sent_at, time.monotonic()
        if handle.get_comm_state() != actionlib.CommState.DONE:
            return
        result = handle.get_result()
        if result is None:  # the goal is lost
            text = "the manager knows nothing of these skills any more: it was started anew"
            result = msgs.ExecuteSkillsResult(self._task, msgs.SkillProgress.FAILURE, -1, text, [], "[]")
        self._result = result
        self._task = result.task_id
        self._ended.set()
        self._begun.set()


class SkillRunner:
    """The client of a manager's action. Any thread.

    :param manager_name: the manager's node name.
    """

    def __init__(self, manager_name: str) -> None:
        self._client = actionlib.ActionClient(f"{manager_name}/execute", msgs.ExecuteSkillsAction)
        # Before anybody is connected: actionlib's own queue of 10 drops goals that are sent in a burst.
        self._client.pub_goal.impl.set_queue_size(MOST_AT_ONCE)
        self._client.pub_cancel.impl.set_queue_size(MOST_AT_ONCE)
        self._watch = ServerWatch(self._client)
        self._lock = threading.Lock()  # actionlib gives two threads the same goal id
        self._taken = _Taken()
        self._runs: weakref.WeakValueDictionary[str, SkillRun] = weakref.WeakValueDictionary()
        # Beside actionlib's own, which leaves out what the result has overtaken.
        topic = self._client.feedback_sub
        self._subscriber = rospy.Subscriber(topic.resolved_name, topic.data_class, self._on_feedback)

    def run(
        self,
        author: str,
        skills: Sequence[Any],
        monitor_cb: Callable[[Any], None] | None = None,
        patience: float = 5.0,
    ) -> SkillRun:
        """Sends a goal.

        :param skills: as `ResourceDescription`.
        :param monitor_cb: called, in a thread of ROS, with each `ExecuteSkillsFeedback`.
        :param patience: s to wait for a manager that is not there.
        :raises TimedOut: there is none.
        """
        end = time.monotonic() + patience
        while not self._watch.is_connected():
            if time.monotonic() > end:
                raise TimedOut(f"{self._watch.name}: no manager answers within {patience:g} s")
            time.sleep(_POLL)
        with self._lock:
            run = SkillRun(self._client, msgs.ExecuteSkillsGoal(author, list(skills)), monitor_cb, self._taken)
            self._runs[run.goal_id] = run
        return run

    def close(self) -> None:
        """No more goals, and no news of those that run."""
        self._client.stop()
        self._subscriber.unregister()

    def _on_feedback(self, message: Any) -> None:
        with self._lock:
            run = self._runs.get(message.status.goal_id.id)
        if run is not None:
            run.on_feedback(message.feedback)
