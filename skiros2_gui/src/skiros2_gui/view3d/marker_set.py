"""The markers of a scene, and where their labels can be read."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from skiros2_common.core.world_element import Element
from skiros2_live.core.markers import TEXT_HEIGHT, ElementMarker
from skiros2_motion.core.geometry import Pose, Vector, composed

#: The height of a line (m), and the width of a letter with its share of the gap beside the text (m).
LINE = 1.25 * TEXT_HEIGHT
_LETTER = 0.75 * TEXT_HEIGHT

#: The slope of the view (tangent) at which labels beside each other are still apart.
_SLOPE = 0.5

#: The most lines by which a label is raised; a label that needs more is hidden.
MAX_LINES = 8


def place_labels(markers: Mapping[str, ElementMarker]) -> dict[str, float | None]:
    """Returns by how much the label of each marker is raised (m); None hides it.

    Labels always face the camera, so that each takes a disc as wide as its text. Seen from above, a label also covers
    what is behind it. Labels of small elements keep their place; those of what they stand on are raised above them.

    :param markers: by id. Their frames are those of other markers, or roots.
    """
    by_frame = {marker.own_frame: marker for marker in markers.values()}
    poses: dict[str, Pose | None] = {}
    anchors = {}
    for eid, marker in markers.items():
        anchor = _in_root(marker, by_frame, poses)
        if anchor is not None:
            anchors[eid] = anchor
    widths = {eid: len(markers[eid].visual.text) * _LETTER for eid in anchors}
    cell = max(widths.values(), default=0.0) or 1.0
    grid: defaultdict[tuple[int, int], list[tuple[Vector, float]]] = defaultdict(list)
    lifts: dict[str, float | None] = dict.fromkeys(markers, 0.0)
    for eid in sorted(anchors, key=lambda e: (markers[e].visual.reach, anchors[e][2], e)):
        x, y, z = anchors[eid]
        column, row = math.floor(x / cell), math.floor(y / cell)
        taken = [
            (other[2], LINE + _SLOPE * distance)
            for i in (column - 1, column, column + 1)
            for j in (row - 1, row, row + 1)
            for other, width in grid.get((i, j), ())
            if (distance := math.hypot(other[0] - x, other[1] - y)) < (width + widths[eid]) / 2.0
        ]
        free = _first_free(z, taken)
        if free - z > MAX_LINES * LINE:
            lifts[eid] = None
        else:
            lifts[eid] = free - z
            grid[column, row].append(((x, y, free), widths[eid]))
    return lifts


def _first_free(z: float, taken: Sequence[tuple[float, float]]) -> float:
    """Returns the lowest height from `z` on that is apart from others.

    :param taken: their heights, and the required distances.
    """
    free = z
    while True:
        above = max((h + gap for h, gap in taken if abs(h - free) < gap - 1e-9), default=free)
        if above <= free:
            return free
        free = above


def _in_root(
    marker: ElementMarker, by_frame: Mapping[str, ElementMarker], poses: dict[str, Pose | None]
) -> Vector | None:
    """Returns the position of a label in the root of its frames; None if the frames have a cycle.

    :param poses: the known poses of frames in their roots.
    """
    if marker.frame not in by_frame:  # most are in a root
        return marker.text_position
    frame = _frame_pose(marker.frame, by_frame, poses)
    if frame is None:
        return None
    return composed(frame, Pose(marker.text_position, (0.0, 0.0, 0.0, 1.0))).position


def _frame_pose(frame: str, by_frame: Mapping[str, ElementMarker], poses: dict[str, Pose | None]) -> Pose | None:
    chain = []
    while frame in by_frame and frame not in poses:
        poses[frame] = None  # of a cycle
        chain.append(frame)
        frame = by_frame[frame].frame
    known = poses.get(frame, None if frame in by_frame else Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    for inner in reversed(chain):
        known = composed(known, by_frame[inner].pose) if known is not None else None
        poses[inner] = known
    return known


@dataclass
class MarkerUpdate:
    """The changes that a view has to apply.

    :param changed: markers that are new or have changed.
    :param removed: markers to delete.
    """

    changed: list[ElementMarker] = field(default_factory=list)
    removed: list[ElementMarker] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.changed or self.removed)


class MarkerSet:
    """The markers that a view shows. Used by one thread.

    :param make: returns the marker of an element, or None.
    """

    def __init__(self, make: Callable[[Element], ElementMarker | None]) -> None:
        self._make = make
        self._markers: dict[str, ElementMarker] = {}
        self._lifts: dict[str, float | None] = {}

    @property
    def all(self) -> Iterable[ElementMarker]:
        """All markers."""
        return self._markers.values()

    def get(self, eid: str) -> ElementMarker | None:
        """Returns the marker of an element, or None."""
        return self._markers.get(eid)

    def place_labels(self) -> MarkerUpdate:
        """Places the labels of all markers; changes of elements keep the places until the next call."""
        bare = {eid: replace(marker, lift=0.0) if marker.lift else marker for eid, marker in self._markers.items()}
        self._lifts = place_labels(bare)
        update = MarkerUpdate()
        for eid, lift in self._lifts.items():
            if self._markers[eid].lift != lift:
                self._markers[eid] = replace(bare[eid], lift=lift)
                update.changed.append(self._markers[eid])
        return update

    def _lifted(self, element: Element) -> ElementMarker | None:
        """Returns the marker of an element with its label in its place."""
        marker = self._make(element)
        lift = self._lifts.get(marker.id, 0.0) if marker is not None else 0.0
        return replace(marker, lift=lift) if marker is not None and lift != 0.0 else marker

    def replace_all(self, elements: Iterable[Element]) -> MarkerUpdate:
        """Replaces all markers with those of the given elements."""
        found: dict[str, Element | None] = {element.id: element for element in elements}
        return self.replace({**dict.fromkeys(self._markers), **found})

    def replace(self, elements: dict[str, Element | None]) -> MarkerUpdate:
        """Replaces the markers of some elements, by id; None deletes the marker."""
        update = MarkerUpdate()
        for eid, element in elements.items():
            before = self._markers.get(eid)
            now = self._lifted(element) if element is not None else None
            if now is not None and now != before:
                self._markers[eid] = now
                update.changed.append(now)
            elif now is None and before is not None:
                del self._markers[eid]
                update.removed.append(before)
        return update
