"""The transforms on tf, and those of a spatial reasoner."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import rospy
import tf2_py
from geometry_msgs.msg import TransformStamped

from skiros2_motion.core.geometry import IDENTITY, Pose, normalized
from skiros2_std_reasoners.ros.packed_transforms import IncomingMessage, PackedMessage

#: Timeout of a lookup right after subscribing to tf (s).
_FIRST_WAIT = 1.0

#: Number of own messages that are recognised on tf.
_OWN_MESSAGES = 10

#: Period of checks in a blocking lookup (s).
_POLL_PERIOD = 0.01


class Transforms:
    """The transforms from tf and the reasoner's own frames, which are available immediately. Thread-safe.

    Subscribes to tf with the first lookup, or with `listen`.

    :param moving: returns (base, pose) of a moving own frame; None for other frames.
    """

    def __init__(self, moving: Callable[[str], tuple[str, Pose] | None] = lambda name: None) -> None:
        self._buffer = tf2_py.BufferCore(rospy.Duration(10.0))
        self._lock = threading.Lock()
        self._moving = moving
        self._subscribers: list[Any] = []
        self._own: set[str] = set()
        self._gone: set[str] = set()
        #: The frames published by other nodes.
        self.elsewhere: set[str] = set()
        self._sent: deque[bytes] = deque(maxlen=_OWN_MESSAGES)

    def listen(self) -> bool:
        """Subscribes to tf. Returns False if it is subscribed already, or this process is not a node."""
        with self._lock:
            if self._subscribers or not rospy.core.is_initialized():
                return False
            self._subscribers = [
                rospy.Subscriber("/tf", IncomingMessage, self._on_tf, False, queue_size=100),
                rospy.Subscriber("/tf_static", IncomingMessage, self._on_tf, True, queue_size=100),
            ]
            return True

    def sent(self, message: PackedMessage) -> None:
        """Registers a message of own frames before it is published; it is ignored on arrival."""
        self._sent.append(message.content)

    def put(self, base: str, name: str, pose: Pose) -> None:
        """Sets an own frame, valid at any time until it is set again."""
        self._own.add(_legal(name))
        self._gone.discard(_legal(name))
        if _legal(base) and _legal(name):
            self._set(transform_message(base, name, pose, rospy.Time(0)), True)

    def drop(self, name: str) -> None:
        """Removes an own frame; it is unknown until tf contains it."""
        self._own.discard(_legal(name))
        self._gone.add(_legal(name))

    def find(self, base: str, target: str, duration: float = 0.0) -> Pose | None:
        """Returns the latest pose of a frame in another one; None if it is unknown.

        :param duration: timeout (s).
        """
        base, target = _legal(base), _legal(target)
        if base == target:
            return IDENTITY
        if self.listen():
            duration = max(duration, _FIRST_WAIT)
        give_up = time.monotonic() + duration
        while True:
            found = self._look_up(base, target)
            if found is not None or time.monotonic() >= give_up:
                return found
            time.sleep(_POLL_PERIOD)

    def at(self, base: str, target: str, stamp: Any) -> Pose | None:
        """Returns the pose of a frame in another one at a time (`rospy.Time`); None if it is unknown. Does not
        block."""
        base, target = _legal(base), _legal(target)
        if base == target:
            return IDENTITY
        try:
            return _pose(self._buffer.lookup_transform_core(base, target, stamp))
        except tf2_py.TransformException:
            return None

    def _look_up(self, base: str, target: str) -> Pose | None:
        latest = rospy.Time(0)
        try:
            chain = self._buffer._chain(base, latest, target, latest, base)
            if not self._gone.isdisjoint(chain):
                return None
            for name in chain:
                moved = self._moving(name) if name in self._own else None
                if moved is not None:
                    self._set(transform_message(moved[0], name, moved[1], latest), True)
            return _pose(self._buffer.lookup_transform_core(base, target, latest))
        except tf2_py.TransformException:
            return None

    def _on_tf(self, message: Any, static: bool) -> None:
        if getattr(message, "content", None) in self._sent:
            return
        is_ours = (getattr(message, "_connection_header", None) or {}).get("callerid") == rospy.get_name()
        for transform in message.transforms:
            name = _legal(transform.child_frame_id)
            if static or not is_ours:  # own frames are on /tf only
                self.elsewhere.add(name)
            if name not in self._own:
                self._gone.discard(name)
                self._set(transform, static)

    def _set(self, transform: Any, static: bool) -> None:
        if static:
            self._buffer.set_transform_static(transform, "skiros")
        else:
            self._buffer.set_transform(transform, "skiros")


def _pose(message: Any) -> Pose:
    """Converts a `TransformStamped` message."""
    t, r = message.transform.translation, message.transform.rotation
    return Pose((t.x, t.y, t.z), normalized((r.x, r.y, r.z, r.w)))


def transform_message(base: str, name: str, pose: Pose, stamp: Any) -> Any:
    """Creates a `TransformStamped` message."""
    message = TransformStamped()
    message.header.frame_id = _legal(base)
    message.header.stamp = stamp
    message.child_frame_id = _legal(name)
    message.transform.translation.x, message.transform.translation.y, message.transform.translation.z = pose.position
    rotation = message.transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = pose.orientation
    return message


def _legal(name: str) -> str:
    """Removes leading slashes and zero characters, which tf2 rejects."""
    return name.lstrip("/").replace("\0", "")
