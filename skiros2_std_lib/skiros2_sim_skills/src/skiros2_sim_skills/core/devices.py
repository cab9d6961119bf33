"""How the drivers of a robot are reached, and the postures of its arms: what the elements of the world model tell.

Names that they do not tell follow the rule of `skiros2_sim.core.names`.
"""

from __future__ import annotations

import json
import math
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_sim.core.names import Address, part_name, robot_name

#: Of a camera: the service `skiros2_sim_msgs/Detect`.
DETECT = Address("skiros:DriverAddress", "/{robot}/{part}/detect")
#: Of a gripper, with the arm as the part: the tf frame between the finger tips, its z out of the hand.
TOOL_FRAME = Address("skiros:LinkedToFrameId", "{robot}/{part}/tool")

JOINT_NAMES = "demo:JointNames"
OPENING = "demo:Opening"
POSTURES = "demo:Postures"


def name_of(address: Address, robot: Element, part: Element | None = None) -> str:
    """The name by which a part of a robot, or the robot itself, is reached."""
    if part is None:
        return address.of(robot, robot_name(robot))
    return address.of(part, robot_name(robot), part_name(part))


def opening(gripper: Element) -> float:
    """How far a gripper opens (m); 0.08 where its element does not tell.

    :raises WrongValue: that is no length.
    """
    value = gripper.value_of(OPENING)
    if value is None:
        return 0.08
    if not _is_number(value) or value <= 0:
        raise WrongValue(f"{gripper!r}: {OPENING} is {value!r}, expected m")
    return float(value)


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
