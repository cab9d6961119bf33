"""Follows the goals of all clients of the task manager."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatusArray

from skiros2_common.core.forward_clock import now
from skiros2_live.core.patch import GoalProgress
from skiros2_msgs import msg as msgs
from skiros2_task.ros.task_manager_interface import ACHIEVE_ACTION


class GoalTopics:
    """The topics of the action `Achieve` of the task manager in this node's namespace.

    :param report: called with each message of a goal, in threads of ROS.
    :param on_status: called with each `GoalStatusArray`, in a thread of ROS.
    """

    def __init__(self, report: Callable[[GoalProgress], None], on_status: Callable[[Any], None]) -> None:
        self._report = report
        self._status = rospy.Subscriber(f"{ACHIEVE_ACTION}/status", GoalStatusArray, on_status, queue_size=1)
        self._goals = [
            rospy.Subscriber(f"{ACHIEVE_ACTION}/{topic}", kind, self._on_goal)
            for topic, kind in (
                ("goal", msgs.AchieveActionGoal),
                ("feedback", msgs.AchieveActionFeedback),
                ("result", msgs.AchieveActionResult),
            )
        ]

    @property
    def is_connected(self) -> bool:
        """Whether a task manager is connected."""
        return bool(self._status.get_num_connections())

    def close(self) -> None:
        """Ends all subscriptions."""
        for subscriber in (self._status, *self._goals):
            subscriber.unregister()

    def _on_goal(self, message: Any) -> None:
        status = getattr(message, "status", None)
        self._report(GoalProgress((status or message).goal_id.id, message, now()))
