"""Converts poses of elements to messages of geometry_msgs, and back."""

from __future__ import annotations

from typing import Any

import rospy
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped, Transform, TransformStamped

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as data
from skiros2_std_reasoners.core.geometry import Pose
from skiros2_std_reasoners.ros.transforms import transform_message

#: Upper bound of times in messages (s).
_NO_TIME = 2.0**32 - 1


def pose_message(element: Element) -> Any:
    """Returns the pose as a `Pose` message."""
    return _pose_message(_known_pose(element))


def pose_stamped_message(element: Element) -> Any:
    """Returns the pose as a `PoseStamped` message in the frame `skiros:BaseFrameId`."""
    message = PoseStamped()
    message.header.frame_id = data.text(element, data.BASE_FRAME)
    message.header.stamp = _stamp(element)
    message.pose = _pose_message(_known_pose(element))
    return message


def transform_stamped_message(element: Element) -> Any:
    """Returns the pose as a `TransformStamped` message from `skiros:BaseFrameId` to `skiros:FrameId`."""
    frame = data.text(element, data.FRAME) or element.id
    return transform_message(data.text(element, data.BASE_FRAME), frame, _known_pose(element), _stamp(element))


def set_from_message(element: Element, message: Any) -> None:
    """Writes the pose in a message, and its frame and time, if it has them.

    :raises WrongType: it is not a `Pose`, `PoseStamped`, `Transform` or `TransformStamped`.
    """
    if isinstance(message, (PoseStamped, TransformStamped)):
        if message.header.frame_id:
            data.set_text(element, data.BASE_FRAME, message.header.frame_id)
        element.setProperty(data.TIME_STAMP, message.header.stamp.to_sec(), "xsd:double")
        message = message.pose if isinstance(message, PoseStamped) else message.transform
    if isinstance(message, PoseMsg):
        position, orientation = message.position, message.orientation
    elif isinstance(message, Transform):
        position, orientation = message.translation, message.rotation
    else:
        raise WrongType(f"{element!r}: expected a pose or transform of geometry_msgs, got {type(message).__name__}")
    data.set_numbers(element, data.POSITION, (position.x, position.y, position.z))
    data.set_numbers(element, data.ORIENTATION, (orientation.x, orientation.y, orientation.z, orientation.w))


def _pose_message(pose: Pose) -> Any:
    message = PoseMsg()
    message.position.x, message.position.y, message.position.z = pose.position
    q = message.orientation
    q.x, q.y, q.z, q.w = pose.orientation
    return message


def _known_pose(element: Element) -> Pose:
    pose = data.pose_of(element)
    if pose is None:
        raise WrongValue(f"{element!r} has no complete pose: a part of its position or orientation is missing")
    return pose


def _stamp(element: Element) -> Any:
    """Returns the time of the pose; 0 if it is unknown or out of the range of messages."""
    stamp = data.numbers(element, [data.TIME_STAMP])[0]
    return rospy.Time.from_sec(stamp) if stamp is not None and 0 < stamp < _NO_TIME else rospy.Time(0)
