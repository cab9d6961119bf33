"""The names by which the drivers of a robot are found: properties of its elements, else names made of their labels.

A robot with the label `demo:mobile_manipulator` is `mobile_manipulator`; an arm with the label `Left arm` `left_arm`.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element

JOINT_NAMES = "demo:JointNames"
POSTURES = "demo:Postures"


def base_action(robot: Element) -> str:
    """The action of the base, move_base_msgs/MoveBase."""
    return _named(robot, "skiros:NavigationExe", f"/{robot_name(robot)}/move_base")


def joint_action(robot: Element, arm: Element) -> str:
    """The action of an arm that moves its joints, control_msgs/FollowJointTrajectory."""
    return _named(arm, "skiros:MotionExe", f"/{robot_name(robot)}/{part_name(arm)}/follow_joint_trajectory")


def cartesian_action(robot: Element, arm: Element) -> str:
    """The action of an arm that moves its tool, skiros2_sim_msgs/CartesianMotion."""
    return _named(arm, "skiros:CartesianGoalAction", f"/{robot_name(robot)}/{part_name(arm)}/cartesian_motion")


def gripper_action(robot: Element, gripper: Element) -> str:
    """The action of a gripper, control_msgs/GripperCommand."""
    return _named(gripper, "skiros:DriverAddress", f"/{robot_name(robot)}/{part_name(gripper)}/gripper_action")


def detect_service(robot: Element, camera: Element) -> str:
    """The service that tells what a camera sees, skiros2_sim_msgs/Detect."""
    return _named(camera, "skiros:DriverAddress", f"/{robot_name(robot)}/{part_name(camera)}/detect")


def switch_service(robot: Element) -> str:
    """The service that switches the controllers of a robot, skiros2_sim_msgs/SwitchController."""
    return f"/{robot_name(robot)}/controller_manager/switch_controller"


def controllers(arm: Element) -> tuple[str, str]:
    """The controllers of an arm: the one that holds positions, and the one that gives way."""
    return (
        _named(arm, "skiros:JointConfigurationController", "position"),
        _named(arm, "skiros:CompliantController", "compliant"),
    )


def tool_frame(robot: Element, arm: Element, gripper: Element) -> str:
    """The tf frame between the finger tips, its z out of the hand."""
    return _named(gripper, "skiros:LinkedToFrameId", f"{robot_name(robot)}/{part_name(arm)}/tool")


def posture(arm: Element, name: str) -> dict[str, float]:
    """A posture of an arm: the position of each joint (rad, m), in order.

    :raises WrongValue: the arm has no such posture, or what it has is none.
    """
    names, postures = _json(arm, JOINT_NAMES, list), _json(arm, POSTURES, dict)
    if name not in postures:
        raise WrongValue(f"{arm!r} has no posture {name!r}; it has: {', '.join(sorted(postures)) or 'none'}")
    positions = postures[name]
    if not isinstance(positions, list) or len(positions) != len(names) or not all(map(_is_number, positions)):
        raise WrongValue(f"{arm!r}: posture {name!r} is {positions!r}, expected {len(names)} numbers")
    return {str(joint): float(position) for joint, position in zip(names, positions, strict=True)}


def robot_name(robot: Element) -> str:
    """The label without its prefix."""
    return str(robot.label).rpartition(":")[2]


def part_name(part: Element) -> str:
    """The label in lower case, with `_` for all that is no letter or digit."""
    return re.sub(r"[^a-z0-9]+", "_", str(part.label).lower()).strip("_")


def _named(element: Element, key: str, default: str) -> str:
    return str(element.value_of(key) or default)


def _json(arm: Element, key: str, kind: type) -> Any:
    text = arm.value_of(key)
    try:
        value = json.loads(str(text))
    except ValueError:
        value = None
    if not isinstance(value, kind) or not value:
        raise WrongValue(f"{arm!r}: {key} is {text!r}, expected a JSON {'list' if kind is list else 'object'}")
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
