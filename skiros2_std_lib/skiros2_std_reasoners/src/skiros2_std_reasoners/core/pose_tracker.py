"""The frames of the elements of a spatial reasoner."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, Vector, composed, rotated
from skiros2_std_reasoners.core import spatial_data as data


@dataclass(frozen=True)
class Frame:
    """The frame of an element.

    :param pose: in the frame `base`, at the time `since`; None if unknown.
    :param written: the pose in the element's properties; older for a moving element.
    :param parent: the target frame of the pose; differs from `base` while the transform is unknown.
    :param linked_to: the tf frame that it follows; "" without one.
    :param pushed_to: an additional name for publishing; "" without one.
    :param velocity: in the frame `base` (m/s).
    :param since: time of the pose (s).
    """

    id: str
    name: str
    base: str
    parent: str
    pose: Pose | None
    written: Pose | None
    published: bool
    linked_to: str
    pushed_to: str
    velocity: Vector
    since: float

    @property
    def is_known(self) -> bool:
        """Whether it can be published on tf."""
        return self.pose is not None and bool(self.base) and self.base != self.name

    @property
    def is_own(self) -> bool:
        """Whether it is known, and not identical to the followed frame, which another node publishes."""
        return self.is_known and self.name != self.linked_to

    @property
    def published_names(self) -> dict[str, str]:
        """The names of the frame on tf, by kind."""
        own = self.name if self.published and self.is_own else ""
        pushed = self.pushed_to if self.is_known else ""
        return {kind: name for kind, name in (("own", own), ("pushed", pushed)) if name}

    @property
    def is_pending(self) -> bool:
        """Whether the pose must still be converted to the parent's frame."""
        return bool(self.parent) and self.parent != self.base and self.pose is not None and not self.linked_to

    @property
    def moves(self) -> bool:
        return any(self.velocity) and self.pose is not None and not self.linked_to

    @property
    def is_busy(self) -> bool:
        """Whether its pose needs updates: it follows a frame, is pending, moves, or has moved."""
        return bool(self.linked_to) or self.is_pending or self.moves or self.pose != self.written

    def at(self, now: float) -> Pose:
        """Returns the pose at a time (s); requires a known pose."""
        assert self.pose is not None
        seconds = now - self.since
        if not self.moves or seconds <= 0.0:
            return self.pose
        x, y, z = (p + v * seconds for p, v in zip(self.pose.position, self.velocity, strict=True))
        return Pose((x, y, z), self.pose.orientation)


def frame_of(element: Element, parent: str, now: float) -> Frame:
    """Creates the frame that an element's properties describe.

    :param parent: the frame of its nearest spatial parent; "" without one.
    :param now: time of the properties (s).
    """
    vx, vy, vz = (v if v is not None and math.isfinite(v) else 0.0 for v in data.numbers(element, data.VELOCITY))
    pose = data.pose_of(element)
    return Frame(
        element.id,
        data.text(element, data.FRAME) or element.id,
        data.text(element, data.BASE_FRAME),
        parent,
        pose,
        pose,
        data.is_true(element, data.PUBLISH),
        data.text(element, data.LINKED_TO),
        data.text(element, data.PUSH_TO),
        (vx, vy, vz),
        now,
    )


def continued(frame: Frame, before: Frame) -> Frame:
    """Continues the motion of an earlier state of a frame, if the properties still contain the old pose.

    The written pose of a moving element is older than its current one; another change of the element must not reset it.
    """
    if before.pose is None or (frame.written, frame.base) != (before.written, before.base):
        return frame
    if frame.velocity == before.velocity:
        return replace(frame, pose=before.pose, since=before.since)
    return replace(frame, pose=before.at(frame.since))


def connected(
    frame: Frame, named: Callable[[str], Frame | None], published_elsewhere: Callable[[str], bool], now: float
) -> Frame:
    """Expresses a frame with a known pose in its nearest ancestor on tf.

    Returns it unchanged if its base is not the frame of an element, or the pose of its base is unknown: another node
    may publish that frame.

    :param named: returns the frame of an element by the name of the frame.
    :param published_elsewhere: whether another node publishes a frame.
    :param now: the time of the returned pose (s).
    """
    passed = {frame.id}
    while (base := named(frame.base)) is not None and base.id not in passed and base.is_own:
        if "own" in base.published_names or published_elsewhere(base.name.lstrip("/")):
            break
        passed.add(base.id)
        frame = _attached(frame, base, now)
    return frame


def _attached(frame: Frame, base: Frame, now: float) -> Frame:
    """Expresses a frame in the base of its base. Frames move without rotation, so velocities add up."""
    outer = base.at(now)
    own, further = (f.velocity if f.moves else (0.0, 0.0, 0.0) for f in (base, frame))
    vx, vy, vz = (a + b for a, b in zip(own, rotated(outer.orientation, further), strict=True))
    pose = composed(outer, frame.at(now))
    return replace(frame, base=base.base, pose=pose, velocity=(vx, vy, vz), since=now, linked_to="")


class PoseTracker:
    """The frames by element. Thread-safe; calls no other code."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: dict[str, Frame] = {}
        self._ids: dict[str, str] = {}  # by name of the frame
        self._busy: set[str] = set()
        self._changed: set[str] = set()

    def put(self, frame: Frame) -> None:
        with self._lock:
            self._put(frame)

    def drop(self, eid: str) -> None:
        with self._lock:
            self._remove_name(eid)
            self._frames.pop(eid, None)
            self._busy.discard(eid)
            self._changed.add(eid)

    def exchange(self, old: Frame, new: Frame) -> bool:
        """Replaces a frame; returns False if it has been replaced meanwhile."""
        with self._lock:
            is_there = self._frames.get(old.id) is old
            if is_there:
                self._put(new)
            return is_there

    def get(self, eid: str) -> Frame | None:
        with self._lock:
            return self._frames.get(eid)

    def named(self, name: str) -> Frame | None:
        """Returns the frame with a name, ignoring a leading slash."""
        with self._lock:
            return self._frames.get(self._ids.get(name.lstrip("/"), ""))

    def all(self) -> list[Frame]:
        with self._lock:
            return list(self._frames.values())

    def busy(self) -> list[Frame]:
        """Returns the frames that need updates."""
        with self._lock:
            return [self._frames[eid] for eid in self._busy]

    def take_changed(self) -> dict[str, Frame | None]:
        """Returns the frames that were set (or None: removed) since the last call, by element."""
        with self._lock:
            changed, self._changed = self._changed, set()
            return {eid: self._frames.get(eid) for eid in changed}

    def _remove_name(self, eid: str) -> None:
        frame = self._frames.get(eid)
        if frame is not None and self._ids.get(frame.name.lstrip("/")) == eid:
            del self._ids[frame.name.lstrip("/")]

    def _put(self, frame: Frame) -> None:
        self._remove_name(frame.id)
        self._ids[frame.name.lstrip("/")] = frame.id
        self._frames[frame.id] = frame
        self._changed.add(frame.id)
        if frame.is_busy:
            self._busy.add(frame.id)
        else:
            self._busy.discard(frame.id)
