"""Describes the differences between two states of the world."""

from __future__ import annotations

import math
import re
from typing import Any

from skiros2_demo.world_state import Thing, WorldState

#: Spatial relations: the side of the moved thing, and a preposition.
_PLACES = {
    "skiros:contain": ("object", "in"),
    "skiros:hasA": ("object", "part of"),
    "skiros:at": ("subject", "at"),
}
_POSE = re.compile(r"skiros:(Position|Orientation)[XYZW]$")
#: Tolerance of poses (m; components of quaternions).
_SAME = 0.01
#: Properties that change with every pose.
_BOOKKEEPING = ("skiros:BaseFrameId", "skiros:TfTimeStamp")


def changes(before: WorldState, after: WorldState) -> list[str]:
    """Returns one line per difference, ordered by thing."""
    lines: list[str] = []
    for thing_id in sorted({*before.things, *after.things}, key=_order):
        was, now = before.things.get(thing_id), after.things.get(thing_id)
        if was is None:
            lines.append(f"{after.name(thing_id)} is new")
        elif now is None:
            lines.append(f"{before.name(thing_id)} is gone")
        else:
            facts = _moves(thing_id, before, after) + _relations(thing_id, before, after) + _properties(was, now)
            lines += [f"{after.name(thing_id)} {fact}" for fact in facts]
    return lines


def _moves(thing_id: str, before: WorldState, after: WorldState) -> list[str]:
    facts = []
    for predicate, (side, word) in _PLACES.items():
        was, now = (_places(thing_id, predicate, side, world) for world in (before, after))
        if was != now:
            there = " and ".join(after.name(i) for i in now) or "nothing"
            gone = " and ".join(before.name(i) for i in was) or "nothing"
            facts.append(f"is {word} {there}; it was {word} {gone}")
    return facts


def _places(thing_id: str, predicate: str, side: str, world: WorldState) -> list[str]:
    if side == "object":
        return world.holders(thing_id, predicate)
    return sorted(o for s, p, o in world.relations if s == thing_id and p == predicate)


def _relations(thing_id: str, before: WorldState, after: WorldState) -> list[str]:
    def others(world: WorldState) -> set[tuple[str, str]]:
        return {
            (p, o) for s, p, o in world.relations
            if s == thing_id and p not in _PLACES and o in before.things and o in after.things
        }  # fmt: skip

    was, now = others(before), others(after)
    new = [f"now {p.rpartition(':')[2]} {after.name(o)}" for p, o in sorted(now - was)]
    return new + [f"no longer {p.rpartition(':')[2]} {before.name(o)}" for p, o in sorted(was - now)]


def _properties(was: Thing, now: Thing) -> list[str]:
    facts = []
    for key in sorted({*was.properties, *now.properties}):
        old, new = was.properties.get(key, []), now.properties.get(key, [])
        if old != new and key not in _BOOKKEEPING and not _POSE.match(key):
            facts.append(f"has {key.rpartition(':')[2]} {_format_values(new)}; it was {_format_values(old)}")
    if _has_moved(was, now):
        position = ", ".join(f"{_number(now, f'Position{axis}'):z.2f}" for axis in "XYZ")
        facts.append(f"is at ({position}) m relative to its parent")
    return facts


def _has_moved(was: Thing, now: Thing) -> bool:
    """Whether the pose has changed by more than the noise of a camera."""
    keys = [f"{part}{axis}" for part, axes in (("Position", "XYZ"), ("Orientation", "XYZW")) for axis in axes]
    return not all(math.isclose(_number(was, key), _number(now, key), rel_tol=0.0, abs_tol=_SAME) for key in keys)


def _number(thing: Thing, key: str) -> float:
    return float(next(iter(thing.properties.get(f"skiros:{key}", [])), 0.0))


def _format_values(values: list[Any]) -> str:
    return ", ".join(str(v) for v in values) or "nothing"


def _order(thing_id: str) -> tuple[int, str]:
    number = re.search(r"-(\d+)$", thing_id)
    return int(number.group(1)) if number else -1, thing_id
