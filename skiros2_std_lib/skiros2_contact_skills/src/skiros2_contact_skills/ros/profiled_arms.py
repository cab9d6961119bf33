"""Arms with the controllers of other projects: the profile is chosen in the world model or by a parameter."""

from __future__ import annotations

from typing import Any

import rospy

from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.ros.profiles import PROFILES
from skiros2_contact_skills.ros.topic_arm import TopicArm
from skiros2_contact_skills.ros.trajectory_arm import TrajectoryArm
from skiros2_motion.core.compliant_arm import CompliantArm
from skiros2_std_skills.core.driver_names import COMPLIANT_CONTROLLER, POSITION_CONTROLLER, part_name, robot_name

#: Of an arm: the name of a profile.
INTERFACE = "skiros:CompliantInterface"
#: Parameter of the skill manager: settings of its arms by name; they replace those of the world model.
PARAMETER = "~compliant_arms"
_KEYS = ("profile", "compliant", "position", "base_frame", "tool_frame", "state", "reference", "wrench", "zero")
_KEYS += ("switch", "controllers", "action", "joint_states", "description")


def profiled_arm(robot: Element, arm: Element) -> CompliantArm | None:
    """Returns a new adapter of an arm; None if no profile is given for it. Does not block.

    :raises UnknownName: there is no such profile.
    :raises ConfigurationError: a setting is invalid, or messages of the driver are not installed.
    """
    name = f"{PARAMETER}/{part_name(arm)}"
    given = checked_settings(rospy.get_param(name, {}), rospy.resolve_name(name))
    profile = given.get("profile") or str(arm.value_of(INTERFACE) or "")
    if not profile:
        return None
    if profile not in PROFILES:
        raise UnknownName(f"interface {profile!r} of {arm!r}: expected one of {', '.join(PROFILES)}")
    controllers = {
        key: address.of(arm, robot_name(robot), part_name(arm))
        for key, address in (("compliant", COMPLIANT_CONTROLLER), ("position", POSITION_CONTROLLER))
    }
    kind = TopicArm if PROFILES[profile].reference else TrajectoryArm
    return kind(PROFILES[profile], controllers | given)


def checked_settings(given: Any, name: str) -> dict[str, str]:
    """Checks the settings of an arm.

    :param name: of the parameter, for the error text.
    :raises ConfigurationError: it is not a table of names, or has unknown keys; the text lists all problems.
    """
    if not isinstance(given, dict):
        raise ConfigurationError(f"parameter {name} is {given!r}, expected a table")
    problems = [f"{key}: expected one of {', '.join(_KEYS)}" for key in given if key not in _KEYS]
    problems += [f"{key} is {value!r}, expected a name" for key, value in given.items() if not isinstance(value, str)]
    if problems:
        raise ConfigurationError(f"parameter {name}: {'; '.join(problems)}")
    return {str(key): str(value) for key, value in given.items()}
