"""Keeps the poses of elements right while the world changes: new parents, frames that are followed, velocities.

The world model offers each change (`parse`); what comes of time and of other transforms is written now and then
(`settle`, `follow`).
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, Protocol

from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_std_reasoners.core.geometry import Pose, composed
from skiros2_std_reasoners.core.pose_tracker import Frame, PoseTracker, frame_of, gone_on

log = logging.getLogger(__name__)

#: A linked pose is written when it has changed by more (m, and in parts of a quaternion).
_NOTICEABLE = 1e-4

_SPATIAL = "skiros:spatiallyRelated"
_REASONER = "skiros:DiscreteReasoner"


class FrameTree(Protocol):
    """Where frames are to each other."""

    def put(self, base: str, name: str, pose: Pose) -> None:
        """A frame of our own."""

    def drop(self, name: str) -> None:
        """A frame is no longer our own."""

    def find(self, base: str, target: str) -> Pose | None:
        """Where a frame is in another one; None when it is not known."""


class PoseKeeper:
    """The frames of the elements that name a reasoner.

    `parse` and `on_change` are called in the threads of those who change the world model, under its lock; `settle` and
    `follow` in the reasoner's.

    :param reasoner: its name, as elements have it in `skiros:DiscreteReasoner`.
    :param clock: the time of velocities (s).
    """

    def __init__(self, reasoner: str, frames: FrameTree, clock: Callable[[], float]) -> None:
        self.tracker = PoseTracker()
        #: The world model; set before use.
        self.wmi: Any = None
        self._reasoner = reasoner
        self._frames = frames
        self._clock = clock
        self._followed_at = 0.0
        #: Elements below which others may have got another parent.
        self._restructured: queue.SimpleQueue[str] = queue.SimpleQueue()
        #: In the thread that writes: the frames that poses were computed from, and when they are so.
        self._computed = threading.local()

    # -- changes of the world model ----------------------------------------------------------------------------

    def read_scene(self) -> None:
        """Tracks the elements of the scene as it is now, and no others; completes them as `parse` does.

        :raises SkirosError: the world model refuses.
        """
        wanted = Element.shared("", "", "", {_REASONER: Property(_REASONER, self._reasoner)}, ())
        with self.wmi.guard:
            for frame in self.tracker.all():
                self._forget(frame.id)
            elements = self.wmi.resolve_elements(wanted)
            for element in elements:
                self.parse(element, "update")
            completed = [element for element in elements if element.changes()]
            if completed:
                self.wmi.update_elements(completed, self._reasoner)

    def parse(self, element: Element, action: str) -> None:
        """Gives a new element its frame, and an element with another parent the pose in that one's frame.

        Elements that do not name the reasoner are ignored.

        :param action: `add`, `update` or `remove`.
        """
        if action == "remove" or not element.hasProperty(_REASONER, self._reasoner):
            self._forget(element.id)
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
            frame = gone_on(frame, before)
        self.tracker.put(frame)
        if before is None or before.name != frame.name:
            self._restructured.put(element.id)  # what is below has it as its parent now
        if frame.is_own and (before is None or not _same_place(before, frame)):
            assert frame.pose is not None
            self._frames.put(frame.base, frame.name, frame.pose)

    def _forget(self, eid: str) -> None:
        frame = self.tracker.get(eid)
        if frame is not None:
            self.tracker.drop(eid)
            self._restructured.put(eid)
            self._frames.drop(frame.name)

    def on_change(self, change: Any) -> None:
        """Notes where parents of elements may have changed that are not parsed for it: below ones without a pose."""
        if change.context != "scene":
            return
        spatial = self._spatial()
        for relation in change.relations:
            if relation["type"] in spatial and self.tracker.get(relation["dst"]) is None:
                self._restructured.put(relation["dst"])

    # -- what time and transforms change -----------------------------------------------------------------------

    def settle(self) -> None:
        """Finds parents that have changed, and writes the poses that waited for a transform, or have come to rest.

        :raises SkirosError: the world model refuses.
        """
        self._find_parents()
        self._write([f for f in self.tracker.busy() if f.waits or not (f.linked_to or f.moves)], self._clock())

    def follow(self) -> None:
        """Writes, in one change, the poses that follow a frame or move. With many it takes its time.

        :raises SkirosError: the world model refuses.
        """
        now = self._clock()
        if now < self._followed_at:  # simulated time begins anew
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
        """Where a frame is that moves: its base and pose now; None for others."""
        frame = self.tracker.named(name)
        return (frame.base, frame.at(self._clock())) if frame is not None and frame.moves else None

    # -- parents -----------------------------------------------------------------------------------------------

    def _spatial(self) -> list[str]:
        return [str(name) for name in self.wmi.get_sub_properties(_SPATIAL)]

    def _parent_frame(self, element: Element) -> str:
        """The frame of the nearest element above that has one, "" when there is none."""
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

    def _find_parents(self) -> None:
        """Looks the parents up anew of the frames below the elements that were noted."""
        relations = self._spatial()
        while not self._restructured.empty():
            above = self._restructured.get()
            own = self.tracker.get(above)
            for eid in self._nearest_below(above, relations):
                frame = self.tracker.get(eid)
                if frame is None or (own is not None and frame.parent == own.name):
                    continue
                element = self.wmi.find_element(eid)
                if element is not None:
                    # parsed meanwhile, it is no longer this frame, and has the newer parent
                    self.tracker.exchange(frame, replace(frame, parent=self._parent_frame(element)))

    def _nearest_below(self, eid: str, relations: list[str]) -> Iterator[str]:
        """The elements with frames that are directly under one, or under others without."""
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
        """When an element is where its properties say: now, or when this thread has computed it.

        What somebody has changed since it was computed stands.
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
        """Expresses the pose in the parent's frame, if the transform is known already."""
        pose = space.pose_of(element)
        if pose is not None and base:
            between = self._frames.find(parent, base)
            if between is None:
                return
            space.set_pose(element, composed(between, pose))
        space.set_text(element, space.BASE_FRAME, parent)

    def _new_pose(self, frame: Frame, now: float) -> tuple[str, Pose] | None:
        """The base and pose that a frame has got; None when there is nothing new."""
        if frame.linked_to:
            base = frame.parent or frame.base
            found = self._frames.find(base, frame.linked_to) if base else None
            if found is None or (frame.base == base and frame.pose is not None and _close(found, frame.pose)):
                return None
            return base, found
        if frame.waits:
            between = self._frames.find(frame.parent, frame.base)
            return None if between is None else (frame.parent, composed(between, frame.at(now)))
        return frame.base, frame.at(now)


def _same_place(one: Frame, other: Frame) -> bool:
    return (one.base, one.name, one.pose) == (other.base, other.name, other.pose)


def _close(one: Pose, other: Pose) -> bool:
    pairs = zip((*one.position, *one.orientation), (*other.position, *other.orientation), strict=True)
    return all(abs(a - b) <= _NOTICEABLE for a, b in pairs)
