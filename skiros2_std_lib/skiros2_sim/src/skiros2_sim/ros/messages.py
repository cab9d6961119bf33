"""Converts poses, wrenches and images of the simulated world to messages, and messages to checked numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, Quaternion, Twist, Vector3, Wrench
from geometry_msgs.msg import Pose as PoseMsg
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from skiros2_common.core.errors import WrongValue
from skiros2_motion.core.geometry import Pose, Vector, normalized
from skiros2_sim.core.camera import Picture

#: Maximum coordinate (m).
_MAX_DISTANCE = 1e6


def pose_message(pose: Pose) -> PoseMsg:
    """Converts a pose to a `Pose` message."""
    return PoseMsg(Point(*pose.position), Quaternion(*pose.orientation))


def pose_from(message: PoseMsg, what: str) -> Pose:
    """Converts a `Pose` message.

    :param what: description for the error text.
    :raises WrongValue: a number is not finite or too large, or the orientation is not a unit quaternion.
    """
    position = vector_from(message.position, f"{what}: position")
    q = message.orientation
    x, y, z, w = (float(number) for number in (q.x, q.y, q.z, q.w))
    if not 0.99 < math.hypot(x, y, z, w) < 1.01:
        raise WrongValue(f"{what}: orientation {(x, y, z, w)}, expected a quaternion of length 1")
    return Pose(position, normalized((x, y, z, w)))


def vector_from(message: Point | Vector3, what: str, most: float = _MAX_DISTANCE) -> Vector:
    """Converts a `Point` or a `Vector3` message.

    :raises WrongValue: a number is not finite or too large.
    """
    x, y, z = (float(number) for number in (message.x, message.y, message.z))
    if not max(abs(x), abs(y), abs(z)) <= most or math.isnan(x + y + z):
        raise WrongValue(f"{what} {(x, y, z)}: expected numbers up to {most:g}")
    return x, y, z


def wrench_message(values: Sequence[float]) -> Wrench:
    """Creates a `Wrench` message: N along and Nm about x, y, z."""
    return Wrench(Vector3(*values[:3]), Vector3(*values[3:]))


def twist_message(linear: Sequence[float], angular: Sequence[float]) -> Twist:
    """Creates a `Twist` message in m/s and rad/s."""
    return Twist(Vector3(*linear), Vector3(*angular))


def colour_image(picture: Picture, header: Header) -> Image:
    """Creates an `Image` message, rgb8."""
    return _image(picture.rgb, "rgb8", header)


def depth_image(picture: Picture, header: Header) -> Image:
    """Creates an `Image` message, 32FC1: depth in m along the optical axis; NaN for the background."""
    return _image(picture.depth, "32FC1", header)


def camera_info(picture: Picture, header: Header) -> CameraInfo:
    """Creates a `CameraInfo` message of a lens without distortion."""
    lens = picture.lens
    k = lens.matrix
    return CameraInfo(
        header=header,
        width=lens.width,
        height=lens.height,
        distortion_model="plumb_bob",
        D=(0.0,) * 5,
        K=k,
        R=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        P=(*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0),
    )


def _image(pixels: npt.NDArray[np.generic], encoding: str, header: Header) -> Image:
    height, width = pixels.shape[:2]
    return Image(
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
        data=pixels.tobytes(),
    )
