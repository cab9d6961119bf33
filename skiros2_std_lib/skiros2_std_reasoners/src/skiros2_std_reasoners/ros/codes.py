"""The codes of `getData` and `setData` for poses and sizes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import from_euler, to_euler
from skiros2_std_reasoners.ros import pose_messages

_POSE = (*space.POSITION, *space.ORIENTATION)


@dataclass(frozen=True)
class Code:
    """Getter and setter of a code, and its properties."""

    keys: Sequence[str]
    get: Callable[[Element], Any]
    set: Callable[[Element, Any], None]


def _numbers(keys: Sequence[str]) -> Code:
    return Code(keys, lambda e: space.numbers(e, keys), lambda e, value: space.set_numbers(e, keys, value))


def _get_pose(element: Element) -> tuple[list[float | None], list[float | None]]:
    return space.numbers(element, space.POSITION), space.numbers(element, space.ORIENTATION)


def _set_pose(element: Element, value: Any) -> None:
    position, orientation = _parts(element, value, 2, "a position and an orientation")
    space.set_numbers(element, space.POSITION, position)
    space.set_numbers(element, space.ORIENTATION, orientation)


def _get_euler(element: Element) -> list[float | None]:
    found = [v for v in space.numbers(element, space.ORIENTATION) if v is not None]
    return list(to_euler(found)) if len(found) == 4 else [None, None, None]


def _set_euler(element: Element, value: Any) -> None:
    roll, pitch, yaw = (float(angle) for angle in _parts(element, value, 3, "roll, pitch and yaw"))
    space.set_numbers(element, space.ORIENTATION, from_euler(roll, pitch, yaw))


def _parts(element: Element, value: Any, count: int, what: str) -> list[Any]:
    try:
        parts = list(value)
    except TypeError:
        parts = []
    if len(parts) != count:
        raise WrongValue(f"{element!r}: expected {what}, got {value!r}")
    return parts


CODES = {
    ":Position": _numbers(space.POSITION),
    ":Orientation": _numbers(space.ORIENTATION),
    ":OrientationEuler": Code(space.ORIENTATION, _get_euler, _set_euler),
    ":Pose": Code(_POSE, _get_pose, _set_pose),
    ":Size": _numbers(space.SIZE),
    ":PoseMsg": Code(_POSE, pose_messages.pose_message, pose_messages.set_from_message),
    ":PoseStampedMsg": Code(_POSE, pose_messages.pose_stamped_message, pose_messages.set_from_message),
    ":TransformMsg": Code(_POSE, pose_messages.transform_stamped_message, pose_messages.set_from_message),
}
