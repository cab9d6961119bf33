"""The arms of a ROS system, by the elements of the world model."""

from __future__ import annotations

import threading

import rospy

from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.ros.finger_widths import FingerWidths
from skiros2_contact_skills.ros.impedance_arm import ImpedanceArm
from skiros2_contact_skills.ros.profiled_arms import interface_of, profiled_arm
from skiros2_contact_skills.ros.profiles import STANDARD
from skiros2_contact_skills.ros.topic_arm import TopicArm
from skiros2_motion.core.compliant_arm import CompliantArm
from skiros2_motion.core.geometry import IDENTITY
from skiros2_sim_msgs.msg import ImpedanceState
from skiros2_std_reasoners.core import spatial_data
from skiros2_std_skills.core import driver_names as names


class RosArms:
    """Connects to the driver of each arm once. Thread-safe."""

    def __init__(self) -> None:
        self._arms: dict[str, CompliantArm] = {}
        self._lock = threading.Lock()
        self._fingers = FingerWidths()

    def width(self, wmi: WorldModelPort, robot: Element, gripper: Element) -> float | None:
        """Returns the distance between the fingers of a gripper (m); None if its joints are not known."""
        return self._fingers.width(robot, gripper)

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> CompliantArm:
        """Returns the arm of an element. Waits for the master only, as a new subscriber does.

        :raises SkirosError: its interface is unknown, or its settings are invalid.
        """
        with self._lock:
            found = self._arms.get(arm.id)
            if isinstance(found, TopicArm) and not found.has_state and has_own_driver(robot, arm):
                found.close()  # the driver started after the first skill
                found = None
            if found is None:
                found = self._arms[arm.id] = connect(wmi, robot, arm)
            return found


def connect(wmi: WorldModelPort, robot: Element, arm: Element) -> CompliantArm:
    """Returns a new connection to the driver of an arm: by the profile that is given; without one, to the driver of
    this project if it is there, or else by standard messages."""
    profile, given = interface_of(arm)
    if not profile and has_own_driver(robot, arm):
        return impedance_arm(robot, arm)
    parts = (wmi.find_element(relation["dst"]) for relation in arm.getRelations("-1", "skiros:hasA"))
    gripper = next((e for e in parts if e is not None and wmi.is_subclass(e.type, "rparts:GripperEffector")), None)
    return profiled_arm(profile or STANDARD, given, robot, arm, gripper)


def has_own_driver(robot: Element, arm: Element) -> bool:
    """Whether no profile is given for an arm, and its state is published as by the simulator."""
    space, _ = _controllers(robot, arm)
    try:
        published = rospy.get_published_topics(space)
    except (rospy.ROSException, OSError):  # no master
        return False
    return not interface_of(arm)[0] and [f"{space}/state", ImpedanceState._type] in published


def impedance_arm(robot: Element, arm: Element) -> ImpedanceArm:
    """Returns a new connection to the driver that the properties of the arm name, or that follows the default names."""
    space, controllers = _controllers(robot, arm)
    robot_name, part = names.robot_name(robot), names.part_name(arm)
    return ImpedanceArm(
        part,
        space,
        names.WRIST.format(robot=robot_name, part=part),
        names.SWITCH_CONTROLLER.format(robot=robot_name),
        controllers,
        spatial_data.pose_of(arm) or IDENTITY,
    )


def _controllers(robot: Element, arm: Element) -> tuple[str, tuple[str, str]]:
    """Returns the namespace of the compliant controller, its name and that of the one that it replaces."""
    robot_name, part = names.robot_name(robot), names.part_name(arm)
    compliant = names.COMPLIANT_CONTROLLER.of(arm, robot_name, part)
    position = names.POSITION_CONTROLLER.of(arm, robot_name, part)
    return names.controller_topics(robot_name, part, compliant), (compliant, position)


ROS_ARMS = RosArms()
