"""Places labels in 3D so that they can be read: one above the other where elements are close."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence

from skiros2_gui.view3d.markers import TEXT_HEIGHT, ElementMarker
from skiros2_std_reasoners.core.geometry import Pose, Vector, composed

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
    """Returns the least height from `z` on that is apart from others.

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
