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
            self._put(frame)

    def publish(self) -> None:
        """Tells tf where the frames are now."""
        for eid, frame in self._tracker.take_changed().items():
            if frame is not None:
                self._put(frame)
            else:
                self._packed.drop((eid, "own"))
                self._packed.drop((eid, "pushed"))
        stamp = rospy.Time.now()
        if len(self._packed) and stamp != rospy.Time(0):  # simulated time may not have begun
            message = self._packed.message(stamp, self._clock())
            self._transforms.sent(message)
            self._publisher.publish(message)

    def close(self) -> None:
        self._publisher.unregister()

    def _put(self, frame: Frame) -> None:
        told = {"own": frame.name if frame.published and frame.is_own else "", "pushed": frame.pushed_to}
        for kind, name in told.items():
            if name and frame.is_known and frame.pose is not None:
                velocity = frame.velocity if frame.moves else (0.0, 0.0, 0.0)
                self._packed.put((frame.id, kind), frame.base, name, frame.pose, velocity, frame.since)
            else:
                self._packed.drop((frame.id, kind))
