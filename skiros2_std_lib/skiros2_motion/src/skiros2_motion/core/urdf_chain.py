"""The kinematics of an arm from the URDF of its robot, for drivers that take joint positions only."""

from __future__ import annotations

import math
from typing import NamedTuple

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.arm_kinematics import ArmKinematics, ChainJoint
from skiros2_motion.core.geometry import IDENTITY, composed
from skiros2_motion.core.urdf import MOVING, axis_of, limits_of, origin_of, parse_urdf

#: The velocity of joints without a limit (rad/s or m/s), and the positions that joints without limits reach.
_VELOCITY, _REACH = 1.0, 2.0 * math.pi


class Chain(NamedTuple):
    """The joints between two links, with their maximum velocities (rad/s or m/s), and their kinematics. Poses are those
    of the tip in the frame of the base."""

    joints: tuple[str, ...]
    velocities: tuple[float, ...]
    kinematics: ArmKinematics


def read_chain(text: str, base: str, tip: str) -> Chain:
    """Returns the chain from one link to another.

    :param text: of a URDF.
    :raises ConfigurationError: it is not a URDF, a link does not exist, no moving joint is between them, or a number is
        invalid.
    """
    urdf = parse_urdf(text)
    links = urdf.links
    missing = [repr(link) for link in (base, tip) if link not in links]
    if missing:
        raise ConfigurationError(f"there is no link {' and no link '.join(missing)}; there are: {', '.join(links)}")
    names, velocities, joints, pose = [], [], [], IDENTITY
    for joint in urdf.path(tip, base):
        try:
            pose = composed(pose, origin_of(joint))
            if joint.get("type") not in MOVING:
                continue
            axis, limits = axis_of(joint), limits_of(joint)
        except ValueError as error:
            raise ConfigurationError(f"joint {joint.get('name')}: {error}") from None
        names.append(joint.get("name", ""))
        velocities.append(limits.velocity or _VELOCITY)
        has_limits = limits.lower < limits.upper
        lower, upper = (max(limits.lower, -_REACH), min(limits.upper, _REACH)) if has_limits else (-_REACH, _REACH)
        joints.append(ChainJoint(0.0, pose, axis, joint.get("type") == "prismatic", lower, upper))
    if not joints:
        raise ConfigurationError(f"no joint moves between link {base!r} and link {tip!r}")
    middle = [(joint.lower + joint.upper) / 2.0 for joint in joints]
    return Chain(tuple(names), tuple(velocities), ArmKinematics(joints, IDENTITY, pose, middle))
