"""The world model as it was at any time of a bag."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.garbage import without_collection
from skiros2_bags.core.world_changes import TimedChange
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import RESET
from skiros2_world_model.core.scene import Scene


def world_at(changes: Sequence[TimedChange], at: float, partial: bool = False) -> Scene:
    """The scene after all changes that were recorded up to a time; the caller's own.

    :param changes: in order.
    :param at: s since the epoch.
    :param partial: what is known although changes are missing.
    :raises BagError: no change was recorded until then, or some are missing, and it is not to be partial.
    """
    past = [timed for timed in changes if timed.time <= at]
    if not past:
        raise BagError(f"the bag holds no change of the world model until {at:.3f} s")
    begin = max((i for i, timed in enumerate(past) if timed.change.action == RESET), default=0)
    gap = next((timed for timed in past[begin:] if timed.gap), None)
    if gap is not None and not partial:
        raise BagError(f"the world at {at:.3f} s is not known, as at {gap.time:.3f} s {gap.gap}")
    scene = Scene()
    with without_collection():
        for timed in past[begin:]:
            apply_change(scene, timed.change)
    return scene
