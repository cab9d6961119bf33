"""What programs call to have a goal planned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import actionlib
import rospy

from skiros2_common.core.errors import Refused, TimedOut
from skiros2_common.tools.decorators import PrettyObject
from skiros2_msgs.msg import AssignTaskAction, AssignTaskGoal

#: Name of the task manager's action, relative, so that a namespace moves the whole system.
ACTION = "tm/task_plan"

#: The codes of a result.
FAILED, NOTHING_TO_DO, PLAN = 1, 2, 3

_CONNECT_SECONDS = 2.0


class TaskManagerInterface(PrettyObject):
    """A client of the task manager, with one request at a time. Its connection is made in the background."""

    def __init__(self) -> None:
        self._client = actionlib.SimpleActionClient(ACTION, AssignTaskAction)
        self._asked = False

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
        goal = AssignTaskGoal(author=rospy.get_name(), goals=text)
        self._client.send_goal(goal, done_cb, None, feedback_cb)
        self._asked = True

    def preempt(self) -> None:
        """Cancels the request, if there is one."""
        if self._asked:
            self._client.cancel_goal()

    def wait_for_result(self) -> Any:
        """Blocks until the request is answered, and returns the `AssignTaskResult`. Not for use in a skill's hook.

        :raises Refused: nothing was asked.
        """
        if not self._asked:
            raise Refused("wait_for_result: nothing was asked; call plan first")
        self._client.wait_for_result()
        return self._client.get_result()
