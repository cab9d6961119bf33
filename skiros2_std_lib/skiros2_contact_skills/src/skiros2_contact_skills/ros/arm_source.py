"""The arms of a ROS system, by the elements of the world model."""

from __future__ import annotations

import threading

from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_contact_skills.ros.impedance_arm import ImpedanceArm
from skiros2_contact_skills.ros.profiled_arms import profiled_arm
from skiros2_motion.core.compliant_arm import CompliantArm
from skiros2_motion.core.geometry import IDENTITY
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_skills.core import driver_names as names


class RosArms:
    """Connects to the driver of each arm once. Thread-safe."""

    def __init__(self) -> None:
        self._arms: dict[str, CompliantArm] = {}
        self._lock = threading.Lock()

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> CompliantArm:
        """Returns the arm of an element. Does not block.

        :raises SkirosError: its interface is unknown, or its settings are invalid.
        """
        with self._lock:
            if arm.id not in self._arms:
                self._arms[arm.id] = profiled_arm(robot, arm) or connect(robot, arm)
            return self._arms[arm.id]


def connect(robot: Element, arm: Element) -> ImpedanceArm:
    """Returns a new connection to the driver that the properties of the arm name, or that follows the default names."""
    robot_name, part = names.robot_name(robot), names.part_name(arm)
    compliant = names.COMPLIANT_CONTROLLER.of(arm, robot_name, part)
    position = names.POSITION_CONTROLLER.of(arm, robot_name, part)
    return ImpedanceArm(
        part,
        names.controller_topics(robot_name, part, compliant),
        names.WRIST.format(robot=robot_name, part=part),
        names.SWITCH_CONTROLLER.format(robot=robot_name),
        (compliant, position),
        space.pose_of(arm) or IDENTITY,
    )


ROS_ARMS = RosArms()
