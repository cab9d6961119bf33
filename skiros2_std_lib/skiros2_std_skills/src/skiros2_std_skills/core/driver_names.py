"""The names of robots and their parts, and of the topics, actions and services of their drivers.

A property of the element gives the name; otherwise a rule derives it.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from skiros2_common.core.world_element import Element


class Address(NamedTuple):
    """The name of a driver's interface.

    :param key: the property of the element that contains the name.
    :param rule: the default; a format string with `robot` and `part`.
    """

    key: str
    rule: str

    def of(self, element: Element, robot: str, part: str = "") -> str:
        """Returns the name for an element.

        :param robot: name of the robot.
        :param part: name of the part; "" for the robot itself.
        """
        return str(element.value_of(self.key) or "") or self.rule.format(robot=robot, part=part)


#: Of a robot: the action `move_base_msgs/MoveBase`.
MOVE = Address("skiros:NavigationExe", "/{robot}/move_base")
#: Of an arm: the action `control_msgs/FollowJointTrajectory`.
TRAJECTORY = Address("skiros:MotionExe", "/{robot}/{part}/follow_joint_trajectory")
#: Of an arm: the action `skiros2_sim_msgs/CartesianMotion`.
CARTESIAN = Address("skiros:CartesianGoalAction", "/{robot}/{part}/cartesian_motion")
#: Of an arm: its planning group in MoveIt.
MOVEIT_GROUP = "skiros:MoveItGroup"
#: Of an arm: the action `skiros2_sim_msgs/PlanMotion`; with `skiros:MoveItGroup`, `moveit_msgs/MoveGroup`.
PLANNER = Address("skiros:MotionPlanner", "/{robot}/{part}/plan_motion")
#: Of an arm: the topic of the wrench at its tool.
WRENCH = Address("skiros:CartesianWrenchTopic", "/{robot}/{part}/wrench")
#: Of an arm: the topic that sets its stiffness.
STIFFNESS = Address("skiros:CartesianStiffnessTopic", "/{robot}/{part}/stiffness")
#: Of an arm: its controllers, as the service that switches them knows them.
POSITION_CONTROLLER = Address("skiros:JointConfigurationController", "position")
COMPLIANT_CONTROLLER = Address("skiros:CompliantController", "compliant")
#: Of an arm: the namespace of the force/torque sensor at its wrist.
WRIST = "/{robot}/{part}/wrist"
#: Of a robot: the services that switch and list controllers.
SWITCH_CONTROLLER = "/{robot}/controller_manager/switch_controller"
LIST_CONTROLLERS = "/{robot}/controller_manager/list_controllers"
#: Of a gripper: the action `control_msgs/GripperCommand`.
GRIPPER = Address("skiros:DriverAddress", "/{robot}/{part}/gripper_action")
#: Of a camera: the topics of its images.
COLOUR = Address("skiros:RgbTopic", "/{robot}/{part}/color/image_raw")
DEPTH = Address("skiros:DepthTopic", "/{robot}/{part}/depth/image_raw")


def controller_topics(robot: str, arm: str, controller: str) -> str:
    """Returns the namespace of a controller: the topics of its commands and its state."""
    return f"/{robot}/{arm}/{re.sub('[^A-Za-z0-9_/]', '_', controller).strip('/') or 'controller'}"


def is_legal(name: str) -> bool:
    """Whether a text is a valid ROS graph name."""
    return re.fullmatch(r"[~/]?[A-Za-z]\w*(/\w+)*", name, re.ASCII) is not None


def robot_name(element: Element) -> str:
    """Returns the name of a robot: its label without the prefix of the ontology."""
    return _plain(element.label.rpartition(":")[2]) or _by_number("robot", element)


def part_name(element: Element) -> str:
    """Returns the name of a part of a robot: its label in lower snake case."""
    return _plain(element.label.rpartition(":")[2].lower()) or _by_number("part", element)


def _plain(text: str) -> str:
    """Removes what a ROS name may not contain: keeps letters, digits and underscores, with a letter first."""
    return re.sub(r"^[\d_]+|_+$", "", re.sub(r"[^A-Za-z0-9]+", "_", text))


def _by_number(kind: str, element: Element) -> str:
    return f"{kind}_{max(element.getIdNumber(), 0)}"
