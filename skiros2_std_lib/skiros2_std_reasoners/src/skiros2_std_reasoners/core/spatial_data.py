"""Pose and size of an element in its properties."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import IDENTITY, Pose, normalized

POSITION = ("skiros:PositionX", "skiros:PositionY", "skiros:PositionZ")
ORIENTATION = ("skiros:OrientationX", "skiros:OrientationY", "skiros:OrientationZ", "skiros:OrientationW")
SIZE = ("skiros:SizeX", "skiros:SizeY", "skiros:SizeZ")
VELOCITY = ("skiros:VelocityX", "skiros:VelocityY", "skiros:VelocityZ")
BASE_FRAME = "skiros:BaseFrameId"
FRAME = "skiros:FrameId"
TIME_STAMP = "skiros:TfTimeStamp"
PUBLISH = "skiros:PublishTf"
LINKED_TO = "skiros:LinkedToFrameId"
PUSH_TO = "skiros:PushToFrameId"

#: All properties of the spatial reasoner.
PROPERTIES = (*POSITION, *ORIENTATION, *SIZE, BASE_FRAME, FRAME, TIME_STAMP, PUBLISH, LINKED_TO, PUSH_TO, *VELOCITY)


def numbers(element: Element, keys: Sequence[str]) -> list[float | None]:
    """Returns the values of properties; None for a missing one, or one that is not a number."""
    return [_number(element.value_of(key)) for key in keys]


def text(element: Element, key: str) -> str:
    """Returns the text of a property; "" if it is missing."""
    return str(element.value_of(key) or "")


def is_true(element: Element, key: str) -> bool:
    """Whether a property is true; accepts text values of scenes."""
    return str(element.value_of(key)).strip().lower() in ("true", "1")


def pose_of(element: Element) -> Pose | None:
    """Returns the pose in the frame `skiros:BaseFrameId`; None if a part is missing or not finite."""
    position, orientation = _finite(element, POSITION), _finite(element, ORIENTATION)
    if position is None or orientation is None:
        return None
    x, y, z = position
    return Pose((x, y, z), normalized(orientation))


def placement_of(element: Element) -> Pose | None:
    """Returns the pose like `pose_of`, with no rotation for a missing orientation."""
    position = _finite(element, POSITION)
    if position is None:
        return None
    x, y, z = position
    return Pose((x, y, z), normalized(_finite(element, ORIENTATION) or IDENTITY.orientation))


def set_pose(element: Element, pose: Pose) -> None:
    """Writes position and orientation."""
    set_numbers(element, POSITION, pose.position)
    set_numbers(element, ORIENTATION, pose.orientation)


def set_numbers(element: Element, keys: Sequence[str], values: Any) -> None:
    """Writes properties.

    :param values: a list, tuple or array with one number per key; None removes a value.
    :raises WrongValue: the number of values is wrong.
    :raises WrongType: a value is not a number.
    """
    try:
        given = list(values)
    except TypeError:
        raise WrongType(f"{element!r}: expected {len(keys)} numbers for {keys[0]} ..., got {values!r}") from None
    if len(given) != len(keys):
        raise WrongValue(f"{element!r}: expected {len(keys)} numbers for {keys[0]} ..., got {given!r}")
    converted: list[float | None] = []
    for value in given:
        try:
            converted.append(None if value is None else float(value))
        except (TypeError, ValueError):
            raise WrongType(f"{element!r}: expected numbers for {keys[0]} ..., got {value!r}") from None
    for key, number in zip(keys, converted, strict=True):
        element.setProperty(key, number, "xsd:float")


def set_text(element: Element, key: str, value: str) -> None:
    """Writes a text."""
    element.setProperty(key, value, "xsd:string")


def _finite(element: Element, keys: Sequence[str]) -> list[float] | None:
    found = [v for v in numbers(element, keys) if v is not None and math.isfinite(v)]
    return found if len(found) == len(keys) else None


def _number(value: Any) -> float | None:
    try:
        return None if value is None or value == "" else float(value)
    except (TypeError, ValueError):
        return None
