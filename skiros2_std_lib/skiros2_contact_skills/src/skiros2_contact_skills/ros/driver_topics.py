"""The topics that command a driver, with the names and messages of its profile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import rospy
from geometry_msgs.msg import Point, PoseStamped, Vector3, WrenchStamped
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Quaternion as QuaternionMessage
from geometry_msgs.msg import Wrench as WrenchMessage
from std_msgs.msg import Header

from skiros2_common.core.errors import Refused
from skiros2_contact_skills.ros.driver_calls import connected, message_class
from skiros2_contact_skills.ros.profiles import Profile
from skiros2_motion.core.geometry import Pose

#: Time in which a driver that listens to references also listens to what it need not have (s of wall time).
_OPTIONAL_TIME = 1.0
_STAMPED = "geometry_msgs/WrenchStamped"


class DriverTopics:
    """Publishers of the commands of a driver.

    :param names: values of the fields of the profile's templates, and any name of the profile that differs.
    :raises ConfigurationError: a message of the driver is not installed.
    """

    def __init__(self, profile: Profile, names: Mapping[str, str]) -> None:
        self._profile, self._names = profile, names
        topics: dict[str, tuple[str, Any]] = {
            "reference": (self.name("reference"), PoseStamped),
            "wrench": (self.name("wrench"), WrenchStamped),
            "stiffness": (names.get("stiffness") or self.format(profile.stiffness.topic), WrenchStamped),
        }
        for key, (topic, kind) in (("damping", profile.damping), ("recovery", profile.recovery)):
            topics[key] = names.get(key) or self.format(topic), message_class(kind) if topic else WrenchStamped
        self._publishers = {
            key: rospy.Publisher(topic, kind, queue_size=10) for key, (topic, kind) in topics.items() if topic
        }

    def format(self, template: str) -> str:
        """Returns a name of the profile without its fields."""
        return template.format(**self._names)

    def name(self, key: str) -> str:
        """Returns the name of a topic, service or frame: the given one, or that of the profile."""
        return self._names.get(key) or self.format(getattr(self._profile, key))

    def takes(self, key: str) -> bool:
        """Whether the driver listens to a topic."""
        return key in self._publishers and self._publishers[key].get_num_connections() > 0

    def connect(self) -> None:
        """Waits until the driver listens.

        :raises Refused: it does not listen to references, or to the stiffness.
        """
        for key in ("reference", "stiffness"):
            self._wait_for(key)
        others = [key for key in ("wrench", "damping") if key in self._publishers]
        connected(lambda: all(map(self.takes, others)), _OPTIONAL_TIME)

    def close(self) -> None:
        """Closes the connections."""
        for publisher in self._publishers.values():
            publisher.unregister()

    # -- commands ---------------------------------------------------------------------------------------------------

    def send_reference(self, pose: Pose) -> None:
        """Sends a pose in the profile's base frame."""
        header = Header(stamp=rospy.Time.now(), frame_id=self.name("base_frame"))
        message = PoseMessage(Point(*pose.position), QuaternionMessage(*pose.orientation))
        self._publishers["reference"].publish(PoseStamped(header, message))

    def send_wrench(self, values: Sequence[float]) -> None:
        """Sends a wrench in the tool frame."""
        header = Header(stamp=rospy.Time.now(), frame_id=self.name("tool_frame"))
        self._publishers["wrench"].publish(WrenchStamped(header, _message(values)))

    def send_stiffness(self, values: Sequence[float]) -> None:
        """Sends a stiffness, if there is a topic for it."""
        if "stiffness" in self._publishers:
            self._publishers["stiffness"].publish(WrenchStamped(wrench=_message(values)))

    def send_damping(self, values: Sequence[float]) -> None:
        """Sends damping factors, if the driver takes them."""
        if self.takes("damping"):
            is_stamped = self._profile.damping[1] in ("", _STAMPED)
            message = _message(values)
            self._publishers["damping"].publish(WrenchStamped(wrench=message) if is_stamped else message)

    def recover(self) -> None:
        """Recovers the driver from a stop, if it has an action for that.

        :raises Refused: it does not listen to it.
        """
        if "recovery" in self._publishers:
            self._wait_for("recovery")
            self._publishers["recovery"].publish(message_class(self._profile.recovery[1])())

    def _wait_for(self, key: str) -> None:
        if key in self._publishers and not connected(lambda: self.takes(key)):
            topic = self._publishers[key].resolved_name
            raise Refused(f"nothing subscribes to {topic}: the controller is not loaded")


def _message(values: Sequence[float]) -> WrenchMessage:
    return WrenchMessage(Vector3(*values[:3]), Vector3(*values[3:]))
