"""What programs call to have a goal planned."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import actionlib
import rospy

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_common.ros.server_watch import ServerWatch
from skiros2_common.tools.decorators import PrettyObject
from skiros2_msgs.msg import AssignTaskAction, AssignTaskGoal

#: Name of the task manager's action, relative, so that a namespace moves the whole system.
ACTION = "tm/task_plan"

#: The codes of a result.
FAILED, NOTHING_TO_DO, PLAN = 1, 2, 3

_CONNECT_SECONDS = 2.0

#: How long a task manager may be silent, or owe a result that it says it has sent (s).
_PATIENCE = 5.0

_LOOK_PERIOD = 0.2  # s


class _Request:
    """One goal that was sent: its end, and its result."""

    def __init__(self, done_cb: Callable[[int, Any], None] | None) -> None:
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
        self._request: _Request | None = None

    def plan(
        self,
        goals: str | Sequence[str],
        done_cb: Callable[[int, Any], None] | None = None,
        feedback_cb: Callable[[Any], None] | None = None,
    ) -> None:
        """Sends goals to be planned and returns; an earlier request of this object is dropped.

        :param goals: the text of the goals, or several.
        :param done_cb: called with the action's state and its `AssignTaskResult`, from a thread of ROS.
        :param feedback_cb: called with each `AssignTaskFeedback`, likewise.
        :raises TimedOut: no task manager has answered within 2 s.
        """
        if not self._client.wait_for_server(rospy.Duration.from_sec(_CONNECT_SECONDS)):
            raise TimedOut(f"no task manager answers on {rospy.resolve_name(ACTION)}")
        text = goals if isinstance(goals, str) else ", ".join(goals)
        request = _Request(done_cb)
        request.handle = self._client.send_goal(
            AssignTaskGoal(author=rospy.get_name(), goals=text),
            request.on_transition,
            (lambda handle, feedback: feedback_cb(feedback)) if feedback_cb is not None else None,
        )
        self._request = request

    def preempt(self) -> None:
        """Cancels the request, if there is one."""
        if self._request is not None:
            self._request.handle.cancel()

    def wait_for_result(self) -> Any:
        """Blocks until the request is answered, and returns the `AssignTaskResult`. Not for use in a skill's hook.

        :raises Refused: nothing was asked.
        :raises TimedOut: the task manager has gone, or its answer was lost.
        """
        if self._request is None:
            raise Refused("wait_for_result: nothing was asked; call plan first")
        watch = ServerWatch(self._client)
        while not self._request.ended.wait(_LOOK_PERIOD):
            if watch.silence() > _PATIENCE:
                raise TimedOut(f"the task manager {watch.name} has not been heard of for {_PATIENCE:g} s")
            if watch.late_result(self._request.handle) > _PATIENCE:
                raise TimedOut(f"the answer of the task manager {watch.name} was lost; ask again")
        return self._request.result
