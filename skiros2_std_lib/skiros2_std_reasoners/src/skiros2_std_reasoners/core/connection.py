"""Connects published frames to frames on tf."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from skiros2_std_reasoners.core.geometry import composed, rotated
from skiros2_std_reasoners.core.pose_tracker import Frame

_AT_REST = (0.0, 0.0, 0.0)


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
    own, further = (f.velocity if f.moves else _AT_REST for f in (base, frame))
    vx, vy, vz = (a + b for a, b in zip(own, rotated(outer.orientation, further), strict=True))
    pose = composed(outer, frame.at(now))
    return replace(frame, base=base.base, pose=pose, velocity=(vx, vy, vz), since=now, linked_to="")
