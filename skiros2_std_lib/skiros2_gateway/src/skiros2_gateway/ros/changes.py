"""What robots have changed in the world model, and quality data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.core.cell import Collected
from skiros2_world_model.core.history import changed_lines
from skiros2_world_model.ros.world_model_interface import WorldModelInterface


def read_changes(
    wm: WorldModelInterface, robots: Sequence[str], start: float, end: float, quality: Mapping[str, tuple[str, str]]
) -> Collected:
    """Reads the changes of robots in a time, and quality data; blocks. See `Cell.collect`."""
    notes = []
    values: dict[str, Any] = {}
    changes: list[dict[str, Any]] = []
    for key, (eid, prop) in quality.items():
        element = wm.find_element(eid)
        if element is None or not element.hasProperty(prop, not_none=True):
            reason = "does not exist" if element is None else f"has no {prop}"
            notes.append(f"quality data {key}: {eid} {reason}")
        else:
            values[key] = element.value_of(prop)
    try:
        for robot in robots:
            for entry in wm.history("", start, end, robot):
                lines = changed_lines(entry)
                related = {eid for s, _, o in entry.changes.relations for eid in (s, o)}
                ids = sorted(related | set(entry.changes.records))
                changes.append({"author": entry.author, "time": entry.stamp, "elements": ids, "lines": lines})
    except SkirosError as error:
        notes.append(f"the changes of the world model are unknown: {error}")
    return Collected(sorted(changes, key=lambda change: change["time"]), values, notes)
