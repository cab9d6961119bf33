"""Publishes on `/tf_static` that frames are the same, as `map` and `world` in `skiros.launch`.

A node of its own for that takes a quarter of a second of a core to start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rospy

from skiros2_common.core.errors import ConfigurationError


def publish_same_frames(pairs: Sequence[str]) -> Any:
    """Publishes that pairs of frames, each as `frame other`, are the same.

    :returns: the publisher, which must be kept; None without pairs.
    :raises ConfigurationError: a text does not have two names.
    """
    if not pairs:
        return None
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    message = TFMessage()
    for pair in pairs:
        names = pair.split()
        if len(names) != 2:
            raise ConfigurationError(f"~same_frames: {pair!r}, expected two names of frames, as 'map world'")
        transform = TransformStamped(child_frame_id=names[1])
        transform.header.frame_id = names[0]
        transform.header.stamp = rospy.Time.now()
        transform.transform.rotation.w = 1.0
        message.transforms.append(transform)
    publisher = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
    publisher.publish(message)
    publisher.impl.add_subscriber_listener(_Kept(publisher.impl, message))
    return publisher


class _Kept(rospy.SubscribeListener):
    """Keeps the frames in the message that a subscriber gets when it connects: it is the last one of the process, and
    a reasoner may publish static frames, too."""

    def __init__(self, topic: Any, message: Any) -> None:
        super().__init__()
        self._topic, self._message = topic, message

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        ours = self._message.transforms
        with self._topic.publock:
            others = [each for each in self._topic.latch.transforms if each not in ours]
            self._topic.latch = type(self._message)([*ours, *others])
