"""The frame on tf that a published frame is connected to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from skiros2_std_reasoners.core.geometry import composed, rotated
from skiros2_std_reasoners.core.pose_tracker import Frame

_AT_REST = (0.0, 0.0, 0.0)


def connected(
    frame: Frame, named: Callable[[str], Frame | None], published_elsewhere: Callable[[str], bool], now: float
) -> Frame:
    """A frame with a known pose, expressed in its nearest ancestor that is on tf.

    It stays as it is when its base is not the frame of an element, or its base's pose is not known: others may publish
    that frame.

    :param named: the frame of an element by the frame's name.
    :param published_elsewhere: whether another node publishes a frame of that name.
    :param now: the time of the returned pose (s).
    """
    passed = {frame.id}
    while (base := named(frame.base)) is not None and base.id not in passed and base.is_own:
        if "own" in base.told or published_elsewhere(base.name.lstrip("/")):
            break
        passed.add(base.id)
        frame = _attached(frame, base, now)
    return frame


def _attached(frame: Frame, base: Frame, now: float) -> Frame:
    """A frame in the base of its base. Frames move without turning, so the velocities add up."""
    outer = base.at(now)
    own, further = (f.velocity if f.moves else _AT_REST for f in (base, frame))
    vx, vy, vz = (a + b for a, b in zip(own, rotated(outer.orientation, further), strict=True))
    pose = composed(outer, frame.at(now))
    return replace(frame, base=base.base, pose=pose, velocity=(vx, vy, vz), since=now, linked_to="")
