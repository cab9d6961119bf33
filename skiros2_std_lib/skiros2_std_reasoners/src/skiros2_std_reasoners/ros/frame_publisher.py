"""The frames of a spatial reasoner on tf."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

import rospy
from tf2_msgs.msg import TFMessage

from skiros2_std_reasoners.core.connection import connected
from skiros2_std_reasoners.core.pose_tracker import Frame, PoseTracker
from skiros2_std_reasoners.ros.packed_transforms import PackedTransforms
from skiros2_std_reasoners.ros.transforms import Transforms


class FramePublisher:
    """Tells tf, in one message, where all frames of a tracker are. Used by one thread.

    All go out on `/tf` each time, also those that do not move: a listener that has had a frame on one of `/tf` and
    `/tf_static` does not follow it to the other, and looks up what does not come any more in vain.

    A frame whose base is not on tf is expressed in its nearest ancestor that is.

    :param transforms: need not read what is published here; knows what others publish.
    :param clock: the time of the tracker's frames (s).
    """

    def __init__(self, tracker: PoseTracker, transforms: Transforms, clock: Callable[[], float]) -> None:
        self._tracker = tracker
        self._transforms = transforms
        self._clock = clock
        self._packed = PackedTransforms()
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._states: dict[str, tuple[str, bool] | None] = {}  # by element: its frame's name, and whether it is skipped
        self._bases: dict[str, str] = {}  # of the elements on tf
        self._below: defaultdict[str, set[str]] = defaultdict(set)  # the same, by base
        self._indirect: set[str] = set()  # those whose base is skipped
        self._elsewhere = 0
        self._put_all({frame.id: frame for frame in tracker.all()})

    def publish(self) -> None:
        """Tells tf where the frames are now."""
        self._put_all(self._tracker.take_changed())
        stamp = rospy.Time.now()
        if len(self._packed) and stamp != rospy.Time(0):  # simulated time may not have begun
            message = self._packed.message(stamp, self._clock())
            self._transforms.sent(message)
            self._publisher.publish(message)

    def _put_all(self, changed: dict[str, Frame | None]) -> None:
        """Puts changed frames, and those that are expressed in another one because of the changes."""
        for eid, frame in changed.items():
            self._put(eid, frame)
        affected = set(self._indirect) if changed else set()
        for eid, frame in changed.items():
            # a base that is known and not on tf is skipped
            now = (frame.name, frame.is_own and "own" not in frame.told) if frame is not None else None
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
        told = frame.told if frame is not None else {}
        self._below[self._bases.pop(eid, "")].discard(eid)
        self._indirect.discard(eid)
        shown = frame
        if frame is not None and told:
            self._bases[eid] = frame.base
            self._below[frame.base].add(eid)
            shown = connected(frame, self._tracker.named, self._transforms.elsewhere.__contains__, self._clock())
            if shown is not frame:
                self._indirect.add(eid)
        for kind in ("own", "pushed"):
            if shown is None or shown.pose is None or kind not in told:
                self._packed.drop((eid, kind))
            else:
                velocity = shown.velocity if shown.moves else (0.0, 0.0, 0.0)
                self._packed.put((eid, kind), shown.base, told[kind], shown.pose, velocity, shown.since)
