"""Changes that only tell where things are: measured as often as there is time while they move, and never alike."""

from __future__ import annotations

import re
from collections.abc import Iterable

from skiros2_bags.core.world_changes import TimedChange
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.apply_change import apply_change
from skiros2_world_model.core.changes import UPDATE, Change
from skiros2_world_model.core.scene import Scene

_POSE = re.compile(r"skiros:(Position[XYZ]|Orientation[XYZW]|TfTimeStamp)")


def without_moves(changes: Iterable[TimedChange]) -> list[TimedChange]:
    """The changes that tell more than where things are.

    :param changes: all of a run, in order.
    """
    scene = Scene()
    told = []
    for timed in changes:
        if not _only_moves(scene, timed.change):
            told.append(timed)
        apply_change(scene, timed.change)
    return told


def _only_moves(scene: Scene, change: Change) -> bool:
    if change.action != UPDATE or change.relations or not change.elements:
        return False
    return all(_is_moved(scene.element(element.id), element) for element in change.elements)


def _is_moved(before: Element | None, after: Element) -> bool:
    """Whether nothing but the pose is otherwise."""
    if before is None or (before.type, before.label) != (after.type, after.label) or _facts(before) != _facts(after):
        return False
    keys = {*before._props, *after._props}
    return all(_POSE.fullmatch(key) for key in keys if _values(before, key) != _values(after, key))


def _facts(element: Element) -> set[tuple[str, ...]]:
    return {(r["src"], r["type"], r["dst"]) for r in element._rels}


def _values(element: Element, key: str) -> list[object] | None:
    prop = element._props.get(key)
    return prop.values if prop is not None else None
