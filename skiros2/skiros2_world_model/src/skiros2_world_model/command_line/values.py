"""Converts elements and history entries to JSON, and parses points of the history."""

from __future__ import annotations

import re
import time
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.history_entry import HistoryEntry, Point

_UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400}
_TIME_FORMATS = ("%Y-%m-%d %H:%M:%S", "%Y-%m-%d %H:%M", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%dT%H:%M", "%Y-%m-%d")


def element_json(element: Element) -> dict[str, Any]:
    """Converts an element to JSON; its relations have both ids."""
    return {
        "id": element.id,
        "type": element.type,
        "label": element.label,
        "properties": {key: p.values for key, p in sorted(element._props.items())},
        "relations": [relation_json(r, element.id) for r in element._rels],
    }


def relation_json(relation: RelationDict, eid: str = "-1") -> dict[str, str]:
    """Converts a relation to JSON with both ids.

    :param eid: replaces "-1".
    """
    return {part: eid if relation[part] == "-1" else relation[part] for part in ("src", "type", "dst")}


def entry_json(entry: HistoryEntry) -> dict[str, Any]:
    """Converts an entry of the history to JSON."""
    return {
        "number": entry.number,
        "stamp": entry.stamp,
        "author": entry.author,
        "action": entry.action,
        "before": [element_json(e) for e in entry.before],
        "after": [element_json(e) for e in entry.after],
        "related": [relation_json(r) for r in entry.related],
        "unrelated": [relation_json(r) for r in entry.unrelated],
        "stated": entry.stated,
        "unstated": entry.unstated,
    }


def point(text: str, now: float) -> Point:
    """Parses a point of the history.

    Formats: a time of today (`14:05`, `14:05:30`), a date and time (`2026-11-21 14:05`), a time ago (`90s`, `10m`,
    `2h`, `3d`), s since the epoch with a decimal point, or the number of a change (`#1795243845958443`).

    :param now: the current time (s since the epoch).
    :raises WrongValue: the text has another format.
    """
    text = text.strip()
    if match := re.fullmatch(r"#?(\d{1,18})", text):
        return int(match[1])
    if match := re.fullmatch(r"(\d+(?:\.\d+)?)([smhd])", text):
        return now - float(match[1]) * _UNITS[match[2]]
    if re.fullmatch(r"\d+\.\d*", text):
        return float(text)
    today = time.strftime("%Y-%m-%d ", time.localtime(now))
    for candidate in (text, today + text):
        for pattern in _TIME_FORMATS:
            try:
                return time.mktime(time.strptime(candidate, pattern))
            except (ValueError, OverflowError):
                continue
    raise WrongValue(f"{text!r} is not a time: expected 14:05, 2026-11-21 14:05, 10m (ago; s, m, h, d) or #NUMBER")
