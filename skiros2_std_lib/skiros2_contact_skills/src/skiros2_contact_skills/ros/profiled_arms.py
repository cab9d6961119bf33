"""Arms whose interface is a profile: chosen in the world model or by a parameter, or the standard one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import rospy

from skiros2_common.core.errors import ConfigurationError, UnknownName
from skiros2_common.core.world_element import Element
from skiros2_contact_skills.ros.profiles import PROFILES, STANDARD
from skiros2_contact_skills.ros.reading_guard import EXACT, NOISY
from skiros2_contact_skills.ros.topic_arm import TopicArm
from skiros2_contact_skills.ros.trajectory_arm import TrajectoryArm
from skiros2_motion.core.geometry import IDENTITY
from skiros2_std_reasoners.core.spatial_data import LINKED_TO, pose_of
from skiros2_std_skills.core.driver_names import (
    COMPLIANT_CONTROLLER,
    POSITION_CONTROLLER,
    controller_topics,
    part_name,
    robot_name,
)

#: Of an arm: the name of a profile.
INTERFACE = "skiros:CompliantInterface"
#: Parameter of the skill manager: settings of its arms by name; they replace those of the world model.
PARAMETER = "~compliant_arms"
_KEYS = ("profile", "compliant", "position", "base_frame", "tool_frame", "state", "reference", "wrench", "zero")
_KEYS += ("stiffness", "damping", "switch", "controllers", "action", "joint_states", "description", "sensor")


def interface_of(arm: Element) -> tuple[str, dict[str, str]]:
    """Returns the name of an arm's profile, "" if none is given, and the settings that replace its names.

    :raises UnknownName: there is no such profile.
    :raises ConfigurationError: a setting is invalid.
    """
    name = f"{PARAMETER}/{part_name(arm)}"
    given = checked_settings(rospy.get_param(name, {}), rospy.resolve_name(name))
    profile = given.pop("profile", "") or str(arm.value_of(INTERFACE) or "")
    if profile and profile not in PROFILES:
        raise UnknownName(f"interface {profile!r} of {arm!r}: expected one of {', '.join(PROFILES)}")
    return profile or (STANDARD if given else ""), given


def profiled_arm(
    profile: str, given: Mapping[str, str], robot: Element, arm: Element, gripper: Element | None
) -> TopicArm:
    """Returns a new adapter of an arm. Does not block.

    Its frames are those given, or else `skiros:LinkedToFrameId` of the arm and of its gripper, or else those of the
    profile.

    :param profile: name of the profile.
    :param given: settings of the arm.
    :raises ConfigurationError: messages of the driver are not installed, or its URDF is invalid.
    """
    names = {"robot": robot_name(robot), "arm": part_name(arm)}
    for key, address in (("compliant", COMPLIANT_CONTROLLER), ("position", POSITION_CONTROLLER)):
        names[key] = address.of(arm, names["robot"], names["arm"])
    for key, element in (("base_frame", arm), ("tool_frame", gripper)):
        if element is not None and (frame := str(element.value_of(LINKED_TO) or "")):
            names[key] = frame
    names |= given
    names["space"] = controller_topics(names["robot"], names["arm"], names["compliant"])
    # the standard frame is that of the robot
    mount = pose_of(arm) if profile == STANDARD and "base_frame" not in names else None
    kind = TopicArm if PROFILES[profile].reference else TrajectoryArm
    return kind(PROFILES[profile], names, mount or IDENTITY)


def checked_settings(given: Any, name: str) -> dict[str, str]:
    """Checks the settings of an arm.

    :param name: of the parameter, for the error text.
    :raises ConfigurationError: it is not a table of names, or has unknown keys; the text lists all problems.
    """
    if not isinstance(given, dict):
        raise ConfigurationError(f"parameter {name} is {given!r}, expected a table")
    problems = [f"{key}: expected one of {', '.join(_KEYS)}" for key in given if key not in _KEYS]
    if given.get("sensor", NOISY) not in (NOISY, EXACT):
        problems.append(f"sensor is {given['sensor']!r}, expected {NOISY} or {EXACT}")
    problems += [f"{key} is {value!r}, expected a name" for key, value in given.items() if not isinstance(value, str)]
    if problems:
        raise ConfigurationError(f"parameter {name}: {'; '.join(problems)}")
    return {str(key): str(value) for key, value in given.items()}
