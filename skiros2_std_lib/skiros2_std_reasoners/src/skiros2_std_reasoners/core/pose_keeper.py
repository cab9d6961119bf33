"""Updates the poses of elements: new parents, followed frames, velocities.

The world model passes each change to `parse`. `settle` and `follow` write the changes caused by time and by other
transforms; they are called periodically.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Protocol

from skiros2_common.core.operations import SCENE, Change
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, composed
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.pose_tracker import Frame, PoseTracker, continued, frame_of

log = logging.getLogger(__name__)

#: Minimum change of a linked pose to be written (m, and components of a quaternion).
_MIN_CHANGE = 1e-4

_SPATIAL = "skiros:spatiallyRelated"
_REASONER = "skiros:DiscreteReasoner"


class FrameTree(Protocol):
    """Poses between frames."""

    def put(self, base: str, name: str, pose: Pose) -> None:
        """Sets an own frame."""

    def drop(self, name: str) -> None:
        """Removes an own frame."""

    def find(self, base: str, target: str) -> Pose | None:
        """Returns the pose of a frame in another one; None if it is unknown."""


class ReasonerModel(Protocol):
    """The world model in `DiscreteReasoner.init`: the calls of this package. Each may raise `WmException`."""

    @property
    def guard(self) -> AbstractContextManager[object]: ...
    def find_element(self, eid: str) -> Element | None: ...
    def resolve_elements(self, description: Element) -> list[Element]: ...
    def update_elements(self, es: Sequence[Element], author: str) -> None: ...
    def get_sub_properties(self, name: str) -> list[str]: ...
    def add_listener(self, listener: Callable[[Change], None]) -> None: ...
    def remove_listener(self, listener: Callable[[Change], None]) -> None: ...


class PoseKeeper:
    """The frames of the elements that name a reasoner.

    `parse` and `on_change` are called by threads that change the world model, under its lock; `settle` and `follow` by
    the reasoner's thread.

    :param reasoner: its name in `skiros:DiscreteReasoner`.
    :param clock: the time of velocities (s).
    """

    def __init__(self, reasoner: str, frames: FrameTree, clock: Callable[[], float]) -> None:
        self.tracker = PoseTracker()
        #: The world model; set before use.
        self.wmi: ReasonerModel
        self._reasoner = reasoner
        self._frames = frames
        self._clock = clock
        self._followed_at = 0.0
        #: Elements whose descendants may have a new parent.
        self._restructured: queue.SimpleQueue[str] = queue.SimpleQueue()
        #: In the writing thread: the frames that the poses were computed from, and their time.
        self._computed = threading.local()

    # -- changes of the world model ----------------------------------------------------------------------------

    def read_scene(self) -> None:
        """Tracks the elements of the current scene, and no others; completes them like `parse`.

        :raises SkirosError: the world model rejects a change.
        """
        wanted = Element.shared("", "", "", {_REASONER: Property(_REASONER, self._reasoner)}, ())
        with self.wmi.guard:
            for frame in self.tracker.all():
                self._remove(frame.id)
            elements = self.wmi.resolve_elements(wanted)
            for element in elements:
                self.parse(element, "update")
            completed = [element for element in elements if element.changes()]
            if completed:
                self.wmi.update_elements(completed, self._reasoner)

    def parse(self, element: Element, action: str) -> None:
        """Assigns a frame to a new element, and converts the pose of an element with a new parent to the parent's
        frame.

        Ignores elements that do not name the reasoner.

        :param action: `add`, `update` or `remove`.
        """
        if action == "remove" or not element.hasProperty(_REASONER, self._reasoner):
            self._remove(element.id)
            return
        before = self.tracker.get(element.id)
        now = self._time_of(element, before)
        if not space.text(element, space.FRAME):
            space.set_text(element, space.FRAME, element.id)
        parent = self._parent_frame(element)
        base = space.text(element, space.BASE_FRAME)
        if parent and parent != base and not space.text(element, space.LINKED_TO):
            if before is not None and before.moves and before.written == space.pose_of(element):
                space.set_pose(element, before.at(now))
            self._rebase(element, base, parent)
        frame = frame_of(element, parent, now)
        if before is not None:
            frame = continued(frame, before)
        self.tracker.put(frame)
        if before is None or before.name != frame.name:
            self._restructured.put(element.id)  # its descendants have a new parent
        if frame.is_own and (before is None or not _same_pose(before, frame)):
            assert frame.pose is not None
            self._frames.put(frame.base, frame.name, frame.pose)

    def _remove(self, eid: str) -> None:
        frame = self.tracker.get(eid)
        if frame is not None:
            self.tracker.drop(eid)
            self._restructured.put(eid)
            self._frames.drop(frame.name)

    def on_change(self, change: Change) -> None:
        """Registers elements whose parents may have changed without `parse`: descendants of elements without a pose."""
        if change.context != SCENE:
            return
        spatial = self._spatial()
        for relation in change.relations:
            if relation["type"] in spatial and self.tracker.get(relation["dst"]) is None:
                self._restructured.put(relation["dst"])

    # -- what time and transforms change -----------------------------------------------------------------------

    def settle(self) -> None:
        """Updates changed parents, and writes poses that waited for a transform, or have come to rest.

        :raises SkirosError: the world model rejects a change.
        """
        self._update_parents()
        self._write([f for f in self.tracker.busy() if f.is_pending or not (f.linked_to or f.moves)], self._clock())

    def follow(self) -> None:
        """Writes the poses that follow a frame or move, in one change. May take long with many of them.

        :raises SkirosError: the world model rejects a change.
        """
        now = self._clock()
        if now < self._followed_at:  # simulated time was reset
            for frame in self.tracker.busy():
                if frame.moves:
                    self.tracker.exchange(frame, replace(frame, pose=frame.at(self._followed_at), since=now))
        self._followed_at = now
        self._write([f for f in self.tracker.busy() if f.linked_to or f.moves], now)

    def _write(self, frames: Iterable[Frame], now: float) -> None:
        changed: list[Element] = []
        computed: dict[str, tuple[Frame, float]] = {}
        for frame in frames:
            pose = self._new_pose(frame, now)
            element = self.wmi.find_element(frame.id) if pose is not None else None
            if element is not None and pose is not None:
                space.set_pose(element, pose[1])
                space.set_text(element, space.BASE_FRAME, pose[0])
                changed.append(element)
                computed[frame.id] = (frame, now)
        if changed:
            self._computed.frames = computed
            try:
                self.wmi.update_elements(changed, self._reasoner)
            finally:
                self._computed.frames = {}

    def moving(self, name: str) -> tuple[str, Pose] | None:
        """Returns base and current pose of a moving frame; None for other frames."""
        frame = self.tracker.named(name)
        return (frame.base, frame.at(self._clock())) if frame is not None and frame.moves else None

    # -- parents -----------------------------------------------------------------------------------------------

    def _spatial(self) -> list[str]:
        return self.wmi.get_sub_properties(_SPATIAL)

    def _parent_frame(self, element: Element) -> str:
        """Returns the frame of the nearest ancestor with a frame; "" without one."""
        relations = self._spatial()
        seen = {element.id}
        waiting = [r["src"] for r in element.getRelations("", relations, "-1")]
        while waiting:
            eid = waiting.pop(0)
            above = self.wmi.find_element(eid) if eid not in seen else None
            seen.add(eid)
            if above is not None:
                if above.hasProperty(_REASONER, self._reasoner):
                    return space.text(above, space.FRAME) or str(above.id)
                waiting += [r["src"] for r in above.getRelations("", relations, "-1")]
        return ""

    def _update_parents(self) -> None:
        """Updates the parents of the descendants of registered elements."""
        relations = self._spatial()
        while not self._restructured.empty():
            above = self._restructured.get()
            own = self.tracker.get(above)
            for eid in self._nearest_descendants(above, relations):
                frame = self.tracker.get(eid)
                if frame is None or (own is not None and frame.parent == own.name):
                    continue
                element = self.wmi.find_element(eid)
                if element is not None:
                    # if it was parsed meanwhile, the exchange fails, and the newer parent stays
                    self.tracker.exchange(frame, replace(frame, parent=self._parent_frame(element)))

    def _nearest_descendants(self, eid: str, relations: list[str]) -> Iterator[str]:
        """Yields the nearest descendants with frames."""
        seen = {eid}
        waiting = [eid]
        while waiting:
            element = self.wmi.find_element(waiting.pop())
            for relation in element.getRelations("-1", relations) if element is not None else ():
                child = relation["dst"]
                if child in seen:
                    continue
                seen.add(child)
                if self.tracker.get(child) is not None:
                    yield child
                else:
                    waiting.append(child)

    # -- poses -------------------------------------------------------------------------------------------------

    def _time_of(self, element: Element, before: Frame | None) -> float:
        """Returns the time of an element's pose: the time of its computation in this thread, else the current time.

        A change by others since the computation is kept.
        """
        frame, computed_at = getattr(self._computed, "frames", {}).pop(element.id, (None, 0.0))
        if frame is None:
            return self._clock()
        if before is not None and before is not frame and before.written is not None:
            space.set_pose(element, before.written)
            space.set_text(element, space.BASE_FRAME, before.base)
            return self._clock()
        return float(computed_at)

    def _rebase(self, element: Element, base: str, parent: str) -> None:
        """Converts the pose to the parent's frame, if the transform is known."""
        pose = space.pose_of(element)
        if pose is not None and base:
            between = self._frames.find(parent, base)
            if between is None:
                return
            space.set_pose(element, composed(between, pose))
        space.set_text(element, space.BASE_FRAME, parent)

    def _new_pose(self, frame: Frame, now: float) -> tuple[str, Pose] | None:
        """Returns the new base and pose of a frame; None without a change."""
        if frame.linked_to:
            base = frame.parent or frame.base
            found = self._frames.find(base, frame.linked_to) if base else None
            if found is None or (frame.base == base and frame.pose is not None and _close(found, frame.pose)):
                return None
            return base, found
        if frame.is_pending:
            between = self._frames.find(frame.parent, frame.base)
            return None if between is None else (frame.parent, composed(between, frame.at(now)))
        return frame.base, frame.at(now)


def _same_pose(one: Frame, other: Frame) -> bool:
    return (one.base, one.name, one.pose) == (other.base, other.name, other.pose)


def _close(one: Pose, other: Pose) -> bool:
    pairs = zip((*one.position, *one.orientation), (*other.position, *other.orientation), strict=True)
    return all(abs(a - b) <= _MIN_CHANGE for a, b in pairs)
