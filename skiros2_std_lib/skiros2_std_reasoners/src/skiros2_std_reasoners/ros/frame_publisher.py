"""Publishes the frames of a spatial reasoner on tf."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

import rospy
from tf2_msgs.msg import TFMessage

from skiros2_std_reasoners.core.pose_tracker import Frame, PoseTracker, connected
from skiros2_std_reasoners.ros.packed_transforms import PackedTransforms
from skiros2_std_reasoners.ros.transforms import Transforms


class FramePublisher:
    """Publishes all frames of a tracker in one message. Not thread-safe.

    All frames are published on `/tf`, including static ones: a listener that received a frame on one of `/tf` and
    `/tf_static` does not accept it on the other.

    A frame whose base is not on tf is expressed in its nearest ancestor on tf.

    :param transforms: knows the frames of other publishers; ignores the messages published here.
    :param clock: the time of the tracker's frames (s).
    """

    def __init__(self, tracker: PoseTracker, transforms: Transforms, clock: Callable[[], float]) -> None:
        self._tracker = tracker
        self._transforms = transforms
        self._clock = clock
        self._packed = PackedTransforms()
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._states: dict[str, tuple[str, bool] | None] = {}  # by element: name of its frame, whether skipped
        self._bases: dict[str, str] = {}  # of the elements on tf
        self._below: defaultdict[str, set[str]] = defaultdict(set)  # elements on tf, by base
        self._indirect: set[str] = set()  # elements with a skipped base
        self._elsewhere = 0
        self._put_all({frame.id: frame for frame in tracker.all()})

    def publish(self) -> None:
        """Publishes the current frames."""
        self._put_all(self._tracker.take_changed())
        stamp = rospy.Time.now()
        if len(self._packed) and stamp != rospy.Time(0):  # simulated time may not have started
            message = self._packed.message(stamp, self._clock())
            self._transforms.sent(message)
            self._publisher.publish(message)

    def _put_all(self, changed: dict[str, Frame | None]) -> None:
        """Updates changed frames, and frames expressed in another base because of the changes."""
        for eid, frame in changed.items():
            self._put(eid, frame)
        affected = set(self._indirect) if changed else set()
        for eid, frame in changed.items():
            # a known base that is not on tf is skipped
            now = (frame.name, frame.is_own and "own" not in frame.published_names) if frame is not None else None
            before, self._states[eid] = self._states.get(eid), now
            for name, _ in filter(None, (before, now) if before != now else ()):
                affected |= self._below[name]
        elsewhere = len(self._transforms.elsewhere)
        if elsewhere != self._elsewhere:
            self._elsewhere = elsewhere
            affected.update(*self._below.values())
        for eid in affected - changed.keys():
            self._put(eid, self._tracker.get(eid))

    def _put(self, eid: str, frame: Frame | None) -> None:
        published_names = frame.published_names if frame is not None else {}
        self._below[self._bases.pop(eid, "")].discard(eid)
        self._indirect.discard(eid)
        shown = frame
        if frame is not None and published_names:
            self._bases[eid] = frame.base
            self._below[frame.base].add(eid)
            shown = connected(frame, self._tracker.named, self._transforms.elsewhere.__contains__, self._clock())
            if shown is not frame:
                self._indirect.add(eid)
        for kind in ("own", "pushed"):
            if shown is None or shown.pose is None or kind not in published_names:
                self._packed.drop((eid, kind))
            else:
                velocity = shown.velocity if shown.moves else (0.0, 0.0, 0.0)
                self._packed.put((eid, kind), shown.base, published_names[kind], shown.pose, velocity, shown.since)
