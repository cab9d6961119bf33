"""Names of driver interfaces, and postures of arms, from elements of the world model.

Default names follow the rules of `skiros2_std_skills.core.driver_names`.
"""

from __future__ import annotations

import json
import math
from typing import TypeGuard, TypeVar

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_std_skills.core.driver_names import Address, part_name, robot_name

J = TypeVar("J", list[object], dict[str, object])

#: Of a camera: the service `skiros2_sim_msgs/Detect`.
DETECT = Address("skiros:DriverAddress", "/{robot}/{part}/detect")
#: Of a gripper, with the arm as the part: the tf frame between the fingertips, z pointing out of the hand.
TOOL_FRAME = Address("skiros:LinkedToFrameId", "{robot}/{part}/tool")

JOINT_NAMES = "skiros:JointNames"
OPENING = "skiros:Opening"
POSTURES = "skiros:Postures"

#: Earlier names of these properties, which scenes may still use.
_EARLIER_NAMES = {JOINT_NAMES: "demo:JointNames", OPENING: "demo:Opening", POSTURES: "demo:Postures"}
#: Default opening of a gripper (m).
_OPENING = 0.08


def name_of(address: Address, robot: Element, part: Element | None = None) -> str:
    """Returns the name of an interface of a robot or of its part."""
    if part is None:
        return address.of(robot, robot_name(robot))
    return address.of(part, robot_name(robot), part_name(part))


def opening(gripper: Element) -> float:
    """Returns the maximum opening of a gripper (m); default 0.08.

    :raises WrongValue: the property is not a length.
    """
    value = _value(gripper, OPENING)
    if value is None:
        return _OPENING
    if not _is_number(value) or value <= 0:
        raise WrongValue(f"{gripper!r}: {OPENING} is {value!r}, expected a length in m")
    return float(value)


def posture(arm: Element, name: str) -> dict[str, float]:
    """Returns a posture of an arm: position by joint (rad, m), in order.

    :raises WrongValue: the arm has no such posture, or it is invalid.
    """
    names, postures = _json(arm, JOINT_NAMES, list), _json(arm, POSTURES, dict)
    if name not in postures:
        raise WrongValue(f"{arm!r} has no posture {name!r}; it has: {', '.join(sorted(postures)) or 'none'}")
    positions = postures[name]
    if not isinstance(positions, list) or len(positions) != len(names) or not all(map(_is_number, positions)):
        raise WrongValue(f"{arm!r}: posture {name!r} is {positions!r}, expected {len(names)} numbers")
    return {str(joint): float(position) for joint, position in zip(names, positions, strict=True)}


def posture_names(arm: Element) -> list[str]:
    """Returns the names of an arm's postures; [] if there are none.

    :raises WrongValue: the property is not a table.
    """
    return list(_json(arm, POSTURES, dict)) if _value(arm, POSTURES) else []


def joint_names(device: Element) -> list[str]:
    """Returns the joints of an arm or of the fingers of a gripper, as its driver names them; [] if they are not known.

    :raises WrongValue: the property is not a list.
    """
    return [str(name) for name in _json(device, JOINT_NAMES, list)] if _value(device, JOINT_NAMES) else []


def _json(arm: Element, key: str, kind: type[J]) -> J:
    text = _value(arm, key)
    try:
        value = json.loads(str(text))
    except ValueError:
        value = None
    if not isinstance(value, kind) or not value:
        raise WrongValue(f"{arm!r}: {key} is {text!r}, expected a JSON {'list' if kind is list else 'object'}")
    return value


def _value(device: Element, key: str) -> object:
    """Returns the value of a property, also under its earlier name; None without one."""
    value = device.value_of(key)
    return device.value_of(_EARLIER_NAMES[key]) if value is None else value


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
