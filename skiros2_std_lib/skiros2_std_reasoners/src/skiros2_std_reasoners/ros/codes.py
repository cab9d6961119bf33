"""The codes of `getData` and `setData`: poses and sizes as lists of numbers, and as messages of geometry_msgs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import rospy
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped, Transform, TransformStamped

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, from_euler, to_euler
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.ros.transforms import transform_message

_POSE = (*space.POSITION, *space.ORIENTATION)

#: Upper bound of times in messages (s).
_NO_TIME = 2.0**32 - 1


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


# -- messages ----------------------------------------------------------------------------------------------------------


def pose_message(element: Element) -> Any:
    """Returns the pose as a `Pose` message."""
    return _message_of(_known_pose(element))


def pose_stamped_message(element: Element) -> Any:
    """Returns the pose as a `PoseStamped` message in the frame `skiros:BaseFrameId`."""
    message = PoseStamped()
    message.header.frame_id = space.text(element, space.BASE_FRAME)
    message.header.stamp = _stamp(element)
    message.pose = _message_of(_known_pose(element))
    return message


def transform_stamped_message(element: Element) -> Any:
    """Returns the pose as a `TransformStamped` message from `skiros:BaseFrameId` to `skiros:FrameId`."""
    frame = space.text(element, space.FRAME) or element.id
    return transform_message(space.text(element, space.BASE_FRAME), frame, _known_pose(element), _stamp(element))


def set_from_message(element: Element, message: Any) -> None:
    """Writes the pose in a message, and its frame and time, if it has them.

    :raises WrongType: it is not a `Pose`, `PoseStamped`, `Transform` or `TransformStamped`.
    """
    if isinstance(message, (PoseStamped, TransformStamped)):
        if message.header.frame_id:
            space.set_text(element, space.BASE_FRAME, message.header.frame_id)
        element.setProperty(space.TIME_STAMP, message.header.stamp.to_sec(), "xsd:double")
        message = message.pose if isinstance(message, PoseStamped) else message.transform
    if isinstance(message, PoseMsg):
        position, orientation = message.position, message.orientation
    elif isinstance(message, Transform):
        position, orientation = message.translation, message.rotation
    else:
        raise WrongType(f"{element!r}: expected a pose or transform of geometry_msgs, got {type(message).__name__}")
    space.set_numbers(element, space.POSITION, (position.x, position.y, position.z))
    space.set_numbers(element, space.ORIENTATION, (orientation.x, orientation.y, orientation.z, orientation.w))


def _message_of(pose: Pose) -> Any:
    message = PoseMsg()
    message.position.x, message.position.y, message.position.z = pose.position
    q = message.orientation
    q.x, q.y, q.z, q.w = pose.orientation
    return message


def _known_pose(element: Element) -> Pose:
    pose = space.pose_of(element)
    if pose is None:
        raise WrongValue(f"{element!r} has no complete pose: a part of its position or orientation is missing")
    return pose


def _stamp(element: Element) -> Any:
    """Returns the time of the pose; 0 if it is unknown or out of the range of messages."""
    stamp = space.numbers(element, [space.TIME_STAMP])[0]
    return rospy.Time.from_sec(stamp) if stamp is not None and 0 < stamp < _NO_TIME else rospy.Time(0)


CODES = {
    ":Position": _numbers(space.POSITION),
    ":Orientation": _numbers(space.ORIENTATION),
    ":OrientationEuler": Code(space.ORIENTATION, _get_euler, _set_euler),
    ":Pose": Code(_POSE, _get_pose, _set_pose),
    ":Size": _numbers(space.SIZE),
    ":PoseMsg": Code(_POSE, pose_message, set_from_message),
    ":PoseStampedMsg": Code(_POSE, pose_stamped_message, set_from_message),
    ":TransformMsg": Code(_POSE, transform_stamped_message, set_from_message),
}
