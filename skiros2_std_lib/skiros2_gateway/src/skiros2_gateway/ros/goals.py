"""Sends goals with ids of the caller's choice to the action `achieve` of the task manager, and follows them.

`actionlib.ActionClient` makes the ids itself, so this client publishes goals and reads the topics of the action. A goal
with the id of a job can be found again after a restart of the gateway: it asks for the goal, see `GoalServer`, and gets
feedback with the steps so far, or the result. The server does not execute a second goal with its id.
"""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import actionlib
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.ros.connections import ServerWatch
from skiros2_common.ros.goal_server import ACTIVE
from skiros2_gateway.core.cell import LOST, UNKNOWN, Ending, Goal, GoalListener, Progress
from skiros2_live.core.patch import TASK_MANAGER, Connection, GoalProgress
from skiros2_live.ros.goals import GoalTopics
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION, ON_RESTART_SERVICE
from skiros2_world_model.core.wm_errors import WmException
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)

#: A goal that the task manager does not list for this time after it was sent, or looked for, is unknown to it (s).
UNKNOWN_AFTER = 5.0
#: The same for a goal that it has listed before, and for the result of an ended goal (s).
FORGOTTEN_AFTER = 2.0
#: A task manager without status messages for this time is lost (s); roslaunch starts a killed one again before.
SILENCE = 30.0
#: A task manager that has sent no status for this time gets no new goals (s); it sends five messages a second.
NOT_READY_AFTER = 2.0

_CHECK_PERIOD = 0.5  # s

#: The outcome by the last status, where the result was lost.
_OUTCOMES = {
    GoalStatus.SUCCEEDED: msgs.AchieveResult.SUCCEEDED,
    GoalStatus.PREEMPTED: msgs.AchieveResult.CANCELLED,
    GoalStatus.RECALLED: msgs.AchieveResult.CANCELLED,
    GoalStatus.ABORTED: msgs.AchieveResult.FAILED,
    GoalStatus.REJECTED: msgs.AchieveResult.FAILED,
}


@dataclass
class _Tracked:
    """A goal that is followed.

    :param since: when it was sent, looked for, or listed last (s, monotonic).
    :param status: the last listed status; -1: never listed.
    :param ended: when its end was listed (s, monotonic); 0: not yet.
    :param asked: when the task manager was asked for it (s, monotonic); 0: not yet.
    :param is_sent: whether this process has sent it, to the task manager's process that runs.
    :param is_heard: whether feedback has come since the task manager was asked.
    """

    since: float
    status: int = -1
    ended: float = 0.0
    text: str = ""
    asked: float = 0.0
    is_sent: bool = False
    is_heard: bool = False


class AchieveGoals:
    """Follows goals. Its methods are called in the thread of the loop; so is the listener.

    :param report: called in the thread of the loop with each message of a goal of any client, and with the connection
        to the task manager if `is_ready` has changed.
    :param changed: called after the latter.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        listener: GoalListener,
        report: Callable[[GoalProgress | Connection], None],
        changed: Callable[[], None],
    ) -> None:
        self._loop = loop
        self._report = report
        self._listener = listener
        self._changed = changed
        self._goals: dict[str, _Tracked] = {}
        self._task_manager = Connection(TASK_MANAGER, rospy.resolve_name(ACHIEVE_ACTION).rpartition("/")[0], False, 0.0)
        report(self._task_manager)
        self._last_status = 0.0  # s, monotonic
        self._connection: object = None  # the header of the connection to the task manager's process
        self._client = actionlib.ActionClient(ACHIEVE_ACTION, msgs.AchieveAction)
        self._client.pub_goal.impl.set_queue_size(1000)
        self._client.pub_cancel.impl.set_queue_size(1000)
        self._watch = ServerWatch(self._client)
        self._topics = GoalTopics(self._hand_over(self._on_message), self._hand_over(self._on_status))
        self._timer = loop.call_later(_CHECK_PERIOD, self._check)

    def close(self) -> None:
        """Stops following. Goals continue in the task manager."""
        self._timer.cancel()
        self._topics.close()
        self._client.stop()

    @property
    def is_ready(self) -> bool:
        """Whether a goal would reach the task manager, and its result this client."""
        return time.monotonic() - self._last_status < NOT_READY_AFTER and self._watch.is_connected()

    def send(self, goal: Goal) -> None:
        """Sends a goal."""
        self._goals[goal.id] = _Tracked(time.monotonic(), is_sent=True)
        message = msgs.AchieveActionGoal()
        message.header.stamp = message.goal_id.stamp = rospy.Time.now()
        message.goal_id.id = goal.id
        wish = goal.quality if goal.plan is None else json.dumps(goal.plan)
        message.goal = msgs.AchieveGoal(rospy.get_name(), goal.text, wish, 0.0, goal.priority, -1)
        self._client.pub_goal.publish(message)

    def follow(self, goal_id: str) -> None:
        """Follows a goal that was sent before, perhaps by an earlier process."""
        self._goals[goal_id] = _Tracked(time.monotonic())
        if self.is_ready:
            self._ask(goal_id)

    def _ask(self, goal_id: str) -> None:
        goal = self._goals[goal_id]
        goal.asked, goal.is_heard = time.monotonic(), False
        message = msgs.AchieveActionGoal(goal_id=GoalID(id=goal_id))
        message.header.stamp = rospy.Time.now()
        self._client.pub_goal.publish(message)

    def cancel(self, goal_id: str) -> None:
        """Requests the cancellation of a goal."""
        self._client.pub_cancel.publish(GoalID(rospy.Time(0), goal_id))

    # -- in the thread of the loop -----------------------------------------------------------------------------

    def _on_message(self, patch: GoalProgress) -> None:
        try:
            if hasattr(patch.message, "feedback"):
                self._on_feedback(patch.goal_id, patch.message.feedback)
            elif hasattr(patch.message, "result"):
                self._on_result(patch.goal_id, patch.message)
        finally:
            self._report(patch)

    def _on_feedback(self, goal_id: str, feedback: Any) -> None:
        if goal_id in self._goals:
            self._goals[goal_id].is_heard = True
            plan, steps = json.loads(feedback.plan or "[]"), json.loads(feedback.steps or "[]")
            self._listener.goal_progress(goal_id, Progress(feedback.phase, feedback.message, plan, steps))

    def _on_result(self, goal_id: str, message: Any) -> None:
        result = message.result
        if self._goals.pop(goal_id, None) is not None:
            if message.status.goal_id.stamp.is_zero():  # the answer to a question
                outcome = UNKNOWN if message.status.status == GoalStatus.REJECTED else LOST
                self._listener.goal_ended(goal_id, Ending(outcome, message.status.text))
                return
            steps, why = json.loads(result.done or "[]"), json.loads(result.explanations or "[]")
            self._listener.goal_ended(goal_id, Ending(result.state, result.message, steps, why))

    def _on_status(self, message: Any) -> None:
        self._last_status = now = time.monotonic()
        if message._connection_header is not self._connection:
            self._connection = message._connection_header
            for known in self._goals.values():  # what another process has published meanwhile was missed
                known.asked, known.is_sent = 0.0, False
        for status in message.status_list:
            goal = self._goals.get(status.goal_id.id)
            if goal is None:
                continue
            if status.status != goal.status and status.status == GoalStatus.ACTIVE:
                self._listener.goal_accepted(status.goal_id.id)
            goal.since, goal.status, goal.text = now, status.status, status.text
            if status.status not in ACTIVE and not goal.ended:
                goal.ended = now

    def _check(self) -> None:
        """Reports goals whose end will not be published, and whether the task manager is ready."""
        now = time.monotonic()
        silent = now - self._last_status
        for goal_id, goal in list(self._goals.items()):
            is_overdue = now - goal.since > (FORGOTTEN_AFTER if goal.status >= 0 else UNKNOWN_AFTER)
            is_due = not goal.is_sent or goal.ended or is_overdue
            if goal.asked:  # the answer may have been lost: each topic has its own connection
                is_due = not goal.is_heard and goal.status in ACTIVE and now - goal.asked > FORGOTTEN_AFTER
            if is_due and silent < 1.0 and self.is_ready:
                self._ask(goal_id)
            elif goal.asked and now - goal.asked < FORGOTTEN_AFTER:
                continue
            elif goal.ended and now - goal.ended > FORGOTTEN_AFTER:
                outcome = _OUTCOMES.get(goal.status, LOST)
                text = f"{goal.text} (the gateway has not received the result)".strip()
                self._end(goal_id, Ending(outcome, text))
            elif silent > SILENCE and now - goal.since > SILENCE:
                self._end(goal_id, Ending(LOST, f"the task manager has sent no status for {SILENCE:g} s"))
            elif silent < 1.0 and goal.status < 0 and now - goal.since > UNKNOWN_AFTER:
                self._end(goal_id, Ending(LOST, "the task manager does not know the goal: it ended, or never arrived"))
            elif silent < 1.0 and goal.status >= 0 and now - goal.since > FORGOTTEN_AFTER:
                self._end(goal_id, Ending(LOST, "the task manager no longer knows the goal: it was restarted"))
        if self.is_ready != self._task_manager.is_up:
            self._task_manager = self._task_manager.updated(not self._task_manager.is_up)
            self._report(self._task_manager)
            self._changed()
        self._timer = self._loop.call_later(_CHECK_PERIOD, self._check)

    def _end(self, goal_id: str, ending: Ending) -> None:
        del self._goals[goal_id]
        self._listener.goal_ended(goal_id, ending)

    def _hand_over(self, handle: Callable[[Any], None]) -> Callable[[Any], None]:
        """Returns a callback for ROS threads that calls a method in the thread of the loop."""

        def callback(message: Any) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(handle, message)

        return callback


def set_on_restart(goal_id: str, on_restart: str) -> None:
    """Sets what happens to a goal when the task manager was restarted; see the service GoalOnRestart. Blocks.

    :raises Refused: the task manager refuses.
    :raises TimedOut: it does not answer.
    """
    service = ServicePool(ON_RESTART_SERVICE, srvs.GoalOnRestart)
    try:
        answer = service.call(srvs.GoalOnRestartRequest(goal_id, on_restart))
    except WmException as error:
        if error.code != SkirosError.code:
            raise
        raise TimedOut(str(error)) from error
    finally:
        service.close()
    if not answer.ok:
        raise Refused(answer.text)
