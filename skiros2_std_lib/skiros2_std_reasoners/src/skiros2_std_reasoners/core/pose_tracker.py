"""The frames of the elements that a spatial reasoner looks after: where each is, and what has to be done for it."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as data
from skiros2_std_reasoners.core.geometry import Pose


@dataclass(frozen=True)
class Frame:
    """The frame of an element.

    :param pose: in the frame `base`; None: not known.
    :param parent: the frame that the pose is to be in; differs from `base` while the transform is not known.
    :param linked_to: the tf frame that it follows, "" for none.
    :param pushed_to: a further name under which it is published, "" for none.
    :param velocity: in the frame `base` (m/s).
    """

    id: str
    name: str
    base: str
    parent: str
    pose: Pose | None
    published: bool
    linked_to: str
    pushed_to: str
    velocity: tuple[float, float, float]

    @property
    def is_known(self) -> bool:
        """Whether it can be told to tf."""
        return self.pose is not None and bool(self.base) and self.base != self.name

    @property
    def is_own(self) -> bool:
        """Whether it is known, and not the very frame that it follows, which somebody else tells to tf."""
        return self.is_known and self.name != self.linked_to

    @property
    def waits(self) -> bool:
        """Whether the pose is still to be expressed in the parent's frame."""
        return bool(self.parent) and self.parent != self.base and self.pose is not None and not self.linked_to

    @property
    def moves(self) -> bool:
        return any(self.velocity) and self.pose is not None

    def moved(self, seconds: float) -> Frame:
        """Where it is some time later, at its velocity."""
        assert self.pose is not None
        x, y, z = (p + v * seconds for p, v in zip(self.pose.position, self.velocity, strict=True))
        return replace(self, pose=Pose((x, y, z), self.pose.orientation))


def frame_of(element: Element, parent: str) -> Frame:
    """The frame that an element's properties describe.

    :param parent: the frame of its nearest spatial parent, "" when it has none.
    """
    vx, vy, vz = (v or 0.0 for v in data.numbers(element, data.VELOCITY))
    return Frame(
        element.id,
        data.text(element, data.FRAME) or element.id,
        data.text(element, data.BASE_FRAME),
        parent,
        data.pose_of(element),
        data.is_true(element, data.PUBLISH),
        data.text(element, data.LINKED_TO),
        data.text(element, data.PUSH_TO),
        (vx, vy, vz),
    )


class PoseTracker:
    """The frames by element. Safe to use from all threads; nothing is called back."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: dict[str, Frame] = {}

    def put(self, frame: Frame) -> None:
        with self._lock:
            self._frames[frame.id] = frame

    def drop(self, eid: str) -> None:
        with self._lock:
            self._frames.pop(eid, None)

    def get(self, eid: str) -> Frame | None:
        with self._lock:
            return self._frames.get(eid)

    def all(self) -> list[Frame]:
        with self._lock:
            return list(self._frames.values())
