"""What programs call to have a goal planned, or achieved."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import actionlib
import rospy

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_common.ros.action_server_watch import ServerWatch
from skiros2_common.ros.subscribers import wait_for_subscribers
from skiros2_common.tools.decorators import PrettyObject
from skiros2_msgs.msg import AchieveAction, AchieveGoal, AssignTaskAction, AssignTaskGoal

log = logging.getLogger(__name__)

#: Names of the task manager's actions, relative, so that a namespace moves the whole system.
ACTION = "tm/task_plan"
ACHIEVE_ACTION = "tm/achieve"

#: The codes of a result.
FAILED, NOTHING_TO_DO, PLAN = 1, 2, 3

_CONNECT_SECONDS = 2.0

#: How long a task manager may be silent, or owe a result that it says it has sent (s).
_PATIENCE = 5.0

_LOOK_PERIOD = 0.2  # s


class _Request:
    """One goal that was sent: its end, and its result."""

    def __init__(self, client: Any, done_cb: Callable[[int, Any], None] | None) -> None:
        self.client = client
        self.handle: Any = None
        self.ended = threading.Event()
        self.result: Any = None
        self._done_cb = done_cb

    def on_transition(self, handle: Any) -> None:
        # Also called before `send_goal` has returned, where actionlib's simple client loses the end of a goal.
        if handle.get_comm_state() == actionlib.CommState.DONE and not self.ended.is_set():
            self.result = handle.get_result()
            self.ended.set()
            if self._done_cb is not None:
                self._done_cb(handle.get_terminal_state(), self.result)


class TaskManagerInterface(PrettyObject):
    """A client of the task manager, with one request at a time. Its connection is made in the background."""

    def __init__(self) -> None:
        self._client = actionlib.ActionClient(ACTION, AssignTaskAction)
        self._achieve_client: Any = None
        self._request: _Request | None = None
        self._heard: list[Any] = []  # clients whose first goal was sent

    def plan(
        self,
        goals: str | Sequence[str],
        done_cb: Callable[[int, Any], None] | None = None,
        feedback_cb: Callable[[Any], None] | None = None,
    ) -> bool:
        """Sends goals to be planned and returns; an earlier request of this object is dropped.

        :param goals: the text of the goals, or several.
        :param done_cb: called with the action's state and its `AssignTaskResult`, from a thread of ROS.
        :param feedback_cb: called with each `AssignTaskFeedback`, from a thread of ROS.
        :returns: True; False where no task manager has answered within 2 s, which is logged.
        """
        try:
            self._send(self._client, AssignTaskGoal(rospy.get_name(), _text(goals)), done_cb, feedback_cb)
        except TimedOut as error:
            log.error("the goal is not planned: %s", error)
            self._request = None
            return False
        return True

    def achieve(
        self,
        goals: str | Sequence[str],
        done_cb: Callable[[int, Any], None] | None = None,
        feedback_cb: Callable[[Any], None] | None = None,
        *,
        wish: str = "",
        seconds: float = 0.0,
        priority: int = 0,
        max_replans: int = -1,
    ) -> None:
        """Sends goals to be planned and carried out by the robots, and returns; an earlier request of this object is
        dropped, but goes on.

        :param goals: the text of the goals, or several.
        :param done_cb: called with the action's state and its `AchieveResult`, from a thread of ROS.
        :param feedback_cb: called with each `AchieveFeedback`, likewise.
        :param wish: `first`, `best` or `optimal` plan; "": as the task manager is set.
        :param seconds: for each planning; 0: as the task manager is set.
        :param priority: where several goals want one robot, the one with the higher priority gets it first.
        :param max_replans: how often it is planned anew at most; negative: as the task manager is set.
        :raises TimedOut: no task manager has answered within 2 s.
        """
        if self._achieve_client is None:
            self._achieve_client = actionlib.ActionClient(ACHIEVE_ACTION, AchieveAction)
        goal = AchieveGoal(rospy.get_name(), _text(goals), wish, seconds, priority, max_replans)
        self._send(self._achieve_client, goal, done_cb, feedback_cb)

    def _send(
        self,
        client: Any,
        goal: Any,
        done_cb: Callable[[int, Any], None] | None,
        feedback_cb: Callable[[Any], None] | None,
    ) -> None:
        if not client.wait_for_server(rospy.Duration.from_sec(_CONNECT_SECONDS)):
            raise TimedOut(f"no task manager answers on {rospy.resolve_name(client.ns)}")
        if client not in self._heard:
            self._heard.append(client)
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
        """Blocks until the request is answered, and returns the `AssignTaskResult` or `AchieveResult`. Not for
        use in a skill's hook.

        :raises Refused: nothing was asked.
        :raises TimedOut: the task manager has gone, or its answer was lost.
        """
        if self._request is None:
            raise Refused("wait_for_result: nothing was asked; call plan first")
        watch = ServerWatch(self._request.client)
        while not self._request.ended.wait(_LOOK_PERIOD):
            if watch.time_since_status() > _PATIENCE:
                raise TimedOut(f"the task manager {watch.name} has not been heard of for {_PATIENCE:g} s")
            if watch.time_without_result(self._request.handle) > _PATIENCE:
                raise TimedOut(f"the answer of the task manager {watch.name} was lost; ask again")
        return self._request.result


def _text(goals: str | Sequence[str]) -> str:
    return goals if isinstance(goals, str) else ", ".join(goals)
