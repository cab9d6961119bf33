"""The topic of a hand-held device: frames, numbers and timeouts of its messages."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
import rospy
from geometry_msgs.msg import TwistStamped

from skiros2_common.core.world_element import Element
from skiros2_skill.testing import SkillBench
from skiros2_teaching.core.teleoperation import Twist
from skiros2_teaching.ros.twist_topic import TwistTopic
from support.ros import Ros, RosMaster, wait_until

pytestmark = pytest.mark.timeout(60)

WAIT = 20.0  # s


@pytest.fixture(scope="module")
def ros(ros_master: RosMaster) -> Iterator[Ros]:
    system = Ros(ros_master)
    yield system
    system.stop()


class Device:
    """A device, and the input of the arm "My arm" of the robot "cell"."""

    def __init__(self) -> None:
        robot, arm = (
            Element("cora:Robot", "cell", "cora:Robot-1"),
            Element("rparts:ArmDevice", "My arm", "rparts:ArmDevice-2"),
        )
        self._bench = SkillBench()
        self.input = TwistTopic.of(self._bench.wmi, robot, arm, "")
        self._publisher = rospy.Publisher("/cell/my_arm/teleoperation", TwistStamped, queue_size=1)
        wait_until(lambda: self._publisher.get_num_connections(), WAIT, "the input of the arm")

    def send(self, frame: str, x: float) -> None:
        message = TwistStamped()
        message.header.frame_id, message.twist.linear.x = frame, x
        self._publisher.publish(message)

    def wait_for(self, frame: str, x: float, expected: Twist | None) -> None:
        """Sends a twist until it is there; None: until there is none."""

        def is_there() -> bool:
            self.send(frame, x)
            return self.input.twist() == expected

        wait_until(is_there, WAIT, f"the twist {expected}")

    def close(self) -> None:
        self.input.close()
        self._publisher.unregister()
        self._bench.close()


@pytest.fixture
def device(ros: Ros) -> Iterator[Device]:
    device = Device()
    yield device
    device.close()


@pytest.mark.parametrize(
    ("frame", "in_tool"),
    [("", True), ("cell/my_arm/tool", True), ("/cell/my_arm/tool", True), ("rparts:ArmDevice-2", False)],
)
def test_frame_of_a_message_is_that_of_the_tool_or_the_base(device: Device, frame: str, in_tool: bool) -> None:
    device.wait_for(frame, 0.1, Twist((0.1, 0.0, 0.0), (0.0, 0.0, 0.0), in_tool))


def test_message_in_an_unknown_frame_or_with_nan_ends_the_motion(device: Device) -> None:
    for frame, x in (("elsewhere", 0.1), ("", math.nan)):
        device.wait_for("", 0.1, Twist((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)))
        device.wait_for(frame, x, None)


def test_twist_ends_without_messages(device: Device) -> None:
    device.wait_for("", 0.1, Twist((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)))
    wait_until(lambda: device.input.twist() is None, WAIT, "the end of the twist")
