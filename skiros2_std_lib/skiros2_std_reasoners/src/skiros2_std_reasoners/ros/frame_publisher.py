"""The frames of a spatial reasoner on tf."""

from __future__ import annotations

from collections.abc import Callable

import rospy
from tf2_msgs.msg import TFMessage

from skiros2_std_reasoners.core.pose_tracker import Frame, PoseTracker
from skiros2_std_reasoners.ros.packed_transforms import PackedTransforms
from skiros2_std_reasoners.ros.transforms import Transforms


class FramePublisher:
    """Tells tf, in one message, where all frames of a tracker are. Used by one thread.

    All go out on `/tf` each time, also those that do not move: a listener that has had a frame on one of `/tf` and
    `/tf_static` does not follow it to the other, and looks up what does not come any more in vain.

    :param transforms: need not read what is published here.
    :param clock: the time of the tracker's frames (s).
    """

    def __init__(self, tracker: PoseTracker, transforms: Transforms, clock: Callable[[], float]) -> None:
        self._tracker = tracker
        self._transforms = transforms
        self._clock = clock
        self._packed = PackedTransforms()
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
        for frame in tracker.all():
            self._put(frame.id, frame)

    def publish(self) -> None:
        """Tells tf where the frames are now."""
        for eid, frame in self._tracker.take_changed().items():
            self._put(eid, frame)
        stamp = rospy.Time.now()
        if len(self._packed) and stamp != rospy.Time(0):  # simulated time may not have begun
            message = self._packed.message(stamp, self._clock())
            self._transforms.sent(message)
            self._publisher.publish(message)

    def close(self) -> None:
        self._publisher.unregister()

    def _put(self, eid: str, frame: Frame | None) -> None:
        told = frame.told if frame is not None else {}
        for kind in ("own", "pushed"):
            if frame is None or frame.pose is None or kind not in told:
                self._packed.drop((eid, kind))
            else:
                velocity = frame.velocity if frame.moves else (0.0, 0.0, 0.0)
                self._packed.put((eid, kind), frame.base, told[kind], frame.pose, velocity, frame.since)
