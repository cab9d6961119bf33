"""The client of the task manager."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import actionlib
import rospy

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_common.ros.connections import ServerWatch, wait_for_subscribers
from skiros2_common.tools.decorators import PrettyObject
from skiros2_msgs.msg import AchieveAction, AchieveGoal, AssignTaskAction, AssignTaskGoal, MakePlanAction, MakePlanGoal

log = logging.getLogger(__name__)

#: Names of the task manager's actions, relative, so that a namespace moves the whole system.
ACTION = "tm/task_plan"
ACHIEVE_ACTION = "tm/achieve"
PLAN_ACTION = "tm/plan"
#: Sets what happens to a goal of `ACHIEVE_ACTION` after a restart of the task manager.
ON_RESTART_SERVICE = "tm/on_restart"

#: The codes of a result.
FAILED, NOTHING_TO_DO, PLAN = 1, 2, 3

_CONNECT_TIMEOUT = 2.0  # s

#: The longest silence of a task manager (s): roslaunch starts a killed one again, and it continues with its goals.
_SILENCE = 30.0
#: The longest delay of a result after its status (s).
_ANSWER_TIMEOUT = 5.0

_POLL_PERIOD = 0.2  # s


#: Called with the terminal state of the action, and its result, by a ROS thread.
DoneCallback = Callable[[int, Any], None]
#: Called with each feedback message, by a ROS thread.
FeedbackCallback = Callable[[Any], None]


class _Request:
    """A goal that was sent, and its result."""

    def __init__(self, client: actionlib.ActionClient, done_cb: DoneCallback | None) -> None:
        self.client = client
        self.handle: Any = None
        self.ended = threading.Event()
        self.result: Any = None
        self._done_cb = done_cb

    def on_transition(self, handle: Any) -> None:
        # May be called before `send_goal` returns; actionlib's simple client would lose the end of the goal.
        if handle.get_comm_state() == actionlib.CommState.DONE and not self.ended.is_set():
            self.result = handle.get_result()
            self.ended.set()
            if self._done_cb is not None:
                self._done_cb(handle.get_terminal_state(), self.result)


class TaskManagerInterface(PrettyObject):
    """A client of the task manager, with one request at a time. Connects in the background.

    Goals are one or several goal texts. A new request replaces an earlier one of this object, which is not cancelled.
    """

    def __init__(self) -> None:
        self._clients = {ACTION: actionlib.ActionClient(ACTION, AssignTaskAction)}
        self._request: _Request | None = None
        self._connected: set[str] = set()  # the actions to which a first goal was sent

    def plan(
        self,
        goals: str | Sequence[str],
        done_cb: DoneCallback | None = None,
        feedback_cb: FeedbackCallback | None = None,
    ) -> bool:
        """Sends goals to plan and returns. The result is an `AssignTaskResult`.

        :returns: False, and logs an error, if no task manager answers within 2 s.
        """
        try:
            goal = AssignTaskGoal(rospy.get_name(), _text(goals))
            self._send(ACTION, AssignTaskAction, goal, done_cb, feedback_cb)
        except TimedOut as error:
            log.error("the goal is not planned: %s", error)
            self._request = None
            return False
        return True

    def achieve(
        self,
        goals: str | Sequence[str],
        done_cb: DoneCallback | None = None,
        feedback_cb: FeedbackCallback | None = None,
        *,
        quality: str = "",
        seconds: float = 0.0,
        priority: int = 0,
        max_replans: int = -1,
    ) -> None:
        """Sends goals to achieve and returns. The result is an `AchieveResult`.

        :param quality: `first`, `best` or `optimal`; "": the task manager's default.
        :param seconds: time limit of each planning; 0: the task manager's default.
        :param priority: of goals that need the same robot, the one with the highest priority gets it first; from
            `interrupt_priority` of the task manager on, a goal stops the steps of goals with a lower priority.
        :param max_replans: how often a broken plan is replaced at most; negative: the task manager's default.
        :raises TimedOut: no task manager answers within 2 s.
        """
        goal = AchieveGoal(rospy.get_name(), _text(goals), quality, seconds, priority, max_replans)
        self._send(ACHIEVE_ACTION, AchieveAction, goal, done_cb, feedback_cb)

    def make_plan(self, goals: str | Sequence[str], *, quality: str = "", seconds: float = 0.0) -> None:
        """Requests the plan for goals, which is not executed, and returns. The result is a `MakePlanResult`.

        :param quality, seconds: see `achieve`.
        :raises TimedOut: no task manager answers within 2 s.
        """
        self._send(PLAN_ACTION, MakePlanAction, MakePlanGoal(rospy.get_name(), _text(goals), quality, seconds))

    def _send(
        self,
        action: str,
        spec: Any,
        goal: Any,
        done_cb: DoneCallback | None = None,
        feedback_cb: FeedbackCallback | None = None,
    ) -> None:
        if action not in self._clients:
            self._clients[action] = actionlib.ActionClient(action, spec)
        client = self._clients[action]
        if not client.wait_for_server(rospy.Duration.from_sec(_CONNECT_TIMEOUT)):
            raise TimedOut(f"no task manager answers on {rospy.resolve_name(client.ns)}")
        if action not in self._connected:
            self._connected.add(action)
            wait_for_subscribers(client.pub_goal)
        request = _Request(client, done_cb)
        on_feedback = (lambda handle, feedback: feedback_cb(feedback)) if feedback_cb is not None else None
        request.handle = client.send_goal(goal, request.on_transition, on_feedback)
        self._request = request

    def preempt(self) -> None:
        """Cancels the request, if there is one."""
        if self._request is not None:
            self._request.handle.cancel()

    def wait_for_result(self) -> Any:
        """Blocks until the request has ended. Returns the action's result. Not for use in a skill's hook.

        :raises Refused: there is no request.
        :raises TimedOut: the task manager has disappeared, or its result was lost.
        """
        if self._request is None:
            raise Refused("wait_for_result: there is no request; call plan first")
        watch = ServerWatch(self._request.client)
        while not self._request.ended.wait(_POLL_PERIOD):
            if watch.time_since_status() > _SILENCE:
                raise TimedOut(f"the task manager {watch.name} has sent no status for {_SILENCE:g} s")
            if watch.time_without_result(self._request.handle) > _ANSWER_TIMEOUT:
                raise TimedOut(f"the result of the task manager {watch.name} was lost; send the request again")
        return self._request.result


def _text(goals: str | Sequence[str]) -> str:
    return goals if isinstance(goals, str) else ", ".join(goals)
