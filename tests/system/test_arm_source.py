"""The source of arms connects each arm by the interface that its element or the manager's parameter names."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rospy

from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.ros.arm_source import RosArms
from skiros2_contact_skills.ros.impedance_arm import ImpedanceArm
from skiros2_contact_skills.ros.topic_arm import TopicArm
from skiros2_contact_skills.ros.trajectory_arm import TrajectoryArm
from skiros2_motion.core.compliant_arm import ArmState, CompliantArm
from skiros2_sim_msgs.msg import ImpedanceState
from skiros2_skill.testing import SkillBench
from support.ros import Ros, RosMaster, wait_until
from support.stand_in_controllers import CartesianControllers, FrankaRos, JointDriver, StandIn, other_packages

pytestmark = pytest.mark.timeout(120)

WAIT = 30.0  # s
ROBOT = Element("cora:Robot", "cell", "cora:Robot-1")
PARAMETER = "~compliant_arms/my_arm"
JOINT_FRAMES = {"base_frame": "panda_link0", "tool_frame": "panda_grasptarget"}


@pytest.fixture(scope="module")
def ros(ros_master: RosMaster) -> Iterator[Ros]:
    system = Ros(ros_master)
    with other_packages():
        yield system
    system.stop()


@pytest.fixture
def arms(ros: Ros) -> Iterator[Arms]:
    made = Arms()
    yield made
    made.close()


class Arms:
    """A source of arms, as a skill manager has it."""

    def __init__(self) -> None:
        self._source = RosArms()
        self._bench = SkillBench()
        self._made: list[CompliantArm] = []

    def arm(
        self, interface: str = "", controller: str = "", parameter: object = None, tool_frame: str = ""
    ) -> CompliantArm:
        """The arm of an element with these properties."""
        if parameter is not None:
            rospy.set_param(PARAMETER, parameter)
        element = Element("rparts:ArmDevice", "My arm", "rparts:ArmDevice-2")
        for key, value in (("skiros:CompliantInterface", interface), ("skiros:CompliantController", controller)):
            if value:
                element.setProperty(key, value, "xsd:string")
        if tool_frame:
            hand = self._bench.add(
                "rparts:GripperEffector", "Hand", self._bench.robot, "skiros:hasA", LinkedToFrameId=tool_frame
            )
            element.addRelation("-1", "skiros:hasA", hand.id)
        self._made.append(self._source.arm(self._bench.wmi, ROBOT, element))
        return self._made[-1]

    def close(self) -> None:
        for arm in set(self._made):
            arm.close()  # type: ignore[attr-defined]
        if rospy.has_param(PARAMETER):
            rospy.delete_param(PARAMETER)
        self._bench.close()


def state_of(arm: CompliantArm) -> ArmState:
    """The state of an arm whose controller runs."""

    def state() -> ArmState | None:
        found = arm.state()
        return found if found is not None and not found.stopped else None

    arm.begin()
    return wait_until(state, WAIT, "a state of the arm")


@pytest.mark.parametrize(
    ("driver_class", "interface", "adapter"),
    [
        (FrankaRos, "franka_ros", TopicArm),
        (CartesianControllers, "cartesian_controllers", TopicArm),
        (JointDriver, "follow_joint_trajectory", TrajectoryArm),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_interface_of_the_element_connects_to_its_driver(
    arms: Arms, driver_class: type[StandIn], interface: str, adapter: type
) -> None:
    driver = driver_class()
    try:
        frames = JOINT_FRAMES if driver_class is JointDriver else {}
        arm = arms.arm(interface, driver.controller_name, frames)
        assert type(arm) is adapter
        assert state_of(arm).pose.position[2] > 0.0
        assert arms.arm(interface) is arm, "each arm is connected once"
    finally:
        driver.close()


def test_parameter_of_the_manager_replaces_the_interface_of_the_element(arms: Arms) -> None:
    driver = FrankaRos()
    try:
        settings = {"profile": "franka_ros", "compliant": driver.controller_name}
        arm = arms.arm("follow_joint_trajectory", "another_controller", settings)
        assert type(arm) is TopicArm
        state_of(arm)
    finally:
        driver.close()


def test_arm_without_interface_is_connected_by_standard_messages(ros: Ros, arms: Arms) -> None:
    assert type(arms.arm()) is TopicArm
    for topic in ("/cell/my_arm/wrist/wrench", "/tf"):
        wait_until(lambda topic=topic: ros.master.subscribers(topic), WAIT, f"a subscriber of {topic}")


def test_arm_without_interface_is_connected_to_the_driver_of_this_project_once_that_is_there(
    ros: Ros, arms: Arms
) -> None:
    assert type(arms.arm()) is TopicArm, "the skill manager may start before the driver"
    driver = rospy.Publisher("/cell/my_arm/compliant/state", ImpedanceState, queue_size=1)
    try:
        assert type(arms.arm()) is ImpedanceArm
        wait_until(lambda: driver.get_num_connections(), WAIT, "a subscriber of the state")
    finally:
        driver.unregister()


def test_tool_frame_is_that_of_the_gripper_in_the_world_model(arms: Arms) -> None:
    driver = CartesianControllers()
    try:
        arm = arms.arm("cartesian_controllers", driver.controller_name, tool_frame="sensor")  # 0.1 m behind tool0
        assert state_of(arm).pose.position[2] == pytest.approx(driver.tool().position[2] + 0.1, abs=0.02)
    finally:
        driver.close()


def test_unknown_interface_and_invalid_settings_are_refused_with_all_problems(arms: Arms) -> None:
    with pytest.raises(UnknownName, match=r"'franka'.*expected one of standard, cartesian_imp"):
        arms.arm("franka")
    with pytest.raises(ConfigurationError, match=r"my_arm: speed: expected one of profile.*; wrench is 3, expected a"):
        arms.arm("franka_ros", parameter={"speed": "high", "wrench": 3})
