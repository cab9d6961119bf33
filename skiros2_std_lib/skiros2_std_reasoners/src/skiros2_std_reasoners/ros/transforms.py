"""The transforms that tf knows, and those that a spatial reasoner tells it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from typing import Any

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from skiros2_std_reasoners.core.geometry import Pose, normalized

#: How long a look-up waits when this process has only begun to listen to tf (s).
_FIRST_WAIT = 1.0

#: How often a look-up that waits looks again (s).
_POLL_PERIOD = 0.01


class Transforms:
    """All transforms known here: what comes over tf, and frames of our own, known at once. Safe in all threads.

    Listening begins with the first look-up, or with `listen`.
    """

    def __init__(self) -> None:
        self._buffer = tf2_py.BufferCore(rospy.Duration(10.0))
        self._lock = threading.Lock()
        self._subscribers: list[Any] = []
        self._own: set[str] = set()

    def listen(self) -> bool:
        """Begins to listen to tf; False when that was so already, or this process is no node."""
        with self._lock:
            if self._subscribers or not rospy.core.is_initialized():
                return False
            self._subscribers = [
                rospy.Subscriber("/tf", TFMessage, self._on_tf, False, queue_size=100),
                rospy.Subscriber("/tf_static", TFMessage, self._on_tf, True, queue_size=100),
            ]
            return True

    def put(self, base: str, name: str, pose: Pose) -> None:
        """A frame of our own: from now on it is there at any time, until it is put elsewhere."""
        self._own.add(_legal(name))
        if _legal(base) and _legal(name):
            self._set(transform_message(base, name, pose, rospy.Time(0)), True)

    def drop(self, name: str) -> None:
        """The frame is no longer our own: what tf says of it counts again."""
        self._own.discard(_legal(name))

    def find(self, base: str, target: str, duration: float = 0.0) -> Pose | None:
        """Where a frame is in another one, as far as known; None when it is not.

        :param duration: how long to wait for it (s).
        """
        if base == target:
            return Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        if self.listen():
            duration = max(duration, _FIRST_WAIT)
        give_up = time.monotonic() + duration
        while True:
            try:
                found = self._buffer.lookup_transform_core(_legal(base), _legal(target), rospy.Time(0)).transform
            except tf2_py.TransformException:
                if time.monotonic() >= give_up:
                    return None
                time.sleep(_POLL_PERIOD)
                continue
            t, r = found.translation, found.rotation
            return Pose((t.x, t.y, t.z), normalized((r.x, r.y, r.z, r.w)))

    def _on_tf(self, message: Any, static: bool) -> None:
        for transform in message.transforms:
            if _legal(transform.child_frame_id) not in self._own:
                self._set(transform, static)

    def _set(self, transform: Any, static: bool) -> None:
        if static:
            self._buffer.set_transform_static(transform, "skiros")
        else:
            self._buffer.set_transform(transform, "skiros")


def transform_message(base: str, name: str, pose: Pose, stamp: Any) -> Any:
    """A `TransformStamped` that says where a frame is in another one."""
    message = TransformStamped()
    message.header.frame_id = _legal(base)
    message.header.stamp = stamp
    message.child_frame_id = _legal(name)
    message.transform.translation.x, message.transform.translation.y, message.transform.translation.z = pose.position
    rotation = message.transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = pose.orientation
    return message


def messages(frames: Iterable[tuple[str, str, Pose]], stamp: Any) -> Any:
    """One message for some frames: (base, name, pose)."""
    return TFMessage([transform_message(*frame, stamp) for frame in frames])


def _legal(name: str) -> str:
    """tf2 knows no leading slash, and fails at a zero character."""
    return name.lstrip("/").replace("\0", "")
