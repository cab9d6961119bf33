"""Twists of a hand-held device on a topic geometry_msgs/TwistStamped."""

from __future__ import annotations

import logging
from collections.abc import Collection

import rospy
from geometry_msgs.msg import TwistStamped

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_std_reasoners.core.spatial_data import LINKED_TO
from skiros2_std_skills.core.devices import TOOL_FRAME
from skiros2_std_skills.core.driver_names import part_name, robot_name
from skiros2_teaching.core.teleoperation import Twist, TwistInput

log = logging.getLogger(__name__)


class TwistTopic(TwistInput):
    """A subscriber of the topic. A message in another frame, or with a number that is not finite, ends the motion.

    :param tool: names of the tool frame; an empty one is also that.
    :param base: names of the arm's base frame.
    """

    def __init__(self, topic: str, tool: Collection[str], base: Collection[str]) -> None:
        super().__init__()
        self._topic, self._tool, self._base = topic, tool, base
        self._problem = ""
        self._subscriber = rospy.Subscriber(topic, TwistStamped, self._on_twist, queue_size=1, tcp_nodelay=True)

    @classmethod
    def of(cls, wmi: WorldModelPort, robot: Element, arm: Element, topic: str) -> TwistTopic:
        """Connects the topic of an arm, by default /ROBOT/ARM/teleoperation."""
        names = robot_name(robot), part_name(arm)
        parts = (wmi.find_element(relation["dst"]) for relation in arm.getRelations("-1", "skiros:hasA"))
        tools = [e for e in parts if e is not None and wmi.is_subclass(e.type, "rparts:GripperEffector")]
        tool = {TOOL_FRAME.of(element, *names) for element in tools} or {
            TOOL_FRAME.rule.format(robot=names[0], part=names[1])
        }
        base = {str(arm.value_of(key) or "") for key in (LINKED_TO, "skiros:FrameId")} - {""} | {arm.id}
        return cls(topic or "/{}/{}/teleoperation".format(*names), tool, base)

    def close(self) -> None:
        self._subscriber.unregister()

    def _on_twist(self, message: TwistStamped) -> None:
        frame, linear, angular = message.header.frame_id.lstrip("/"), message.twist.linear, message.twist.angular
        in_tool = not frame or frame in self._tool
        try:
            if not in_tool and frame not in self._base:
                self.stop()
                known = ", ".join(sorted([*self._tool, *self._base]))
                raise WrongValue(f"frame {frame!r}: expected an empty one or one of {known}")
            self.put(Twist((linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z), in_tool))
            self._problem = ""
        except SkirosError as error:
            if self._problem != str(error):
                log.warning("%s: %s", self._topic, error)
            self._problem = str(error)
