"""The kinematics of an arm from the URDF of its robot, for drivers that take joint positions only."""

from __future__ import annotations

import math
import xml.etree.ElementTree as xml
from typing import NamedTuple

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.arm_kinematics import ArmKinematics, ChainJoint
from skiros2_motion.core.geometry import IDENTITY, composed
from skiros2_motion.core.urdf import origin_of, vector

_MOVING = ("revolute", "continuous", "prismatic")


class Chain(NamedTuple):
    """The joints between two links, with their maximum velocities (rad/s or m/s), and their kinematics. Poses are those
    of the tip in the frame of the base."""

    joints: tuple[str, ...]
    velocities: tuple[float, ...]
    kinematics: ArmKinematics


def read_chain(urdf: str, base: str, tip: str) -> Chain:
    """Returns the chain from one link to another.

    :param urdf: text of a URDF.
    :raises ConfigurationError: it is not a URDF, a link does not exist, no moving joint is between them, or a number is
        invalid.
    """
    try:
        top = xml.fromstring(urdf)
    except xml.ParseError as error:
        raise ConfigurationError(f"robot_description is not a URDF: {error}") from None
    links = [link.get("name", "") for link in top.iter("link")]
    missing = [repr(link) for link in (base, tip) if link not in links]
    if missing:
        raise ConfigurationError(f"there is no link {' and no link '.join(missing)}; there are: {', '.join(links)}")
    above = {_of(joint, "child", "link"): joint for joint in top.findall("joint")}
    path: list[xml.Element] = []
    link = tip
    while link != base:
        if link not in above or len(path) > len(above):
            raise ConfigurationError(f"link {tip!r} is not a descendant of link {base!r}")
        path.insert(0, above[link])
        link = _of(path[0], "parent", "link")
    names, velocities, joints, pose = [], [], [], IDENTITY
    for joint in path:
        try:
            pose = composed(pose, origin_of(joint))
            if joint.get("type") not in _MOVING:
                continue
            axis = vector(_of(joint, "axis", "xyz"), "1 0 0")
        except ValueError as error:
            raise ConfigurationError(f"joint {joint.get('name')}: {error}") from None
        names.append(joint.get("name", ""))
        velocities.append(_number(joint, "limit", "velocity", 1.0))
        has_limits = joint.get("type") != "continuous"
        lower, upper = (
            _number(joint, "limit", key, default) if has_limits else default
            for key, default in (("lower", -2.0 * math.pi), ("upper", 2.0 * math.pi))
        )
        joints.append(ChainJoint(0.0, pose, axis, joint.get("type") == "prismatic", lower, upper))
    if not joints:
        raise ConfigurationError(f"no joint moves between link {base!r} and link {tip!r}")
    middle = [(joint.lower + joint.upper) / 2.0 for joint in joints]
    return Chain(tuple(names), tuple(velocities), ArmKinematics(joints, IDENTITY, pose, middle))


def _of(joint: xml.Element, tag: str, key: str) -> str:
    found = joint.find(tag)
    return found.get(key, "") if found is not None else ""


def _number(joint: xml.Element, tag: str, key: str, default: float) -> float:
    text = _of(joint, tag, key)
    try:
        value = float(text) if text else default
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigurationError(f"joint {joint.get('name')}: {key} is {text!r}, expected a number")
    return value
