"""Formats values, elements and relations as short texts for the command line and the GUI."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from typing import Any

from skiros2_common.core.names import local_name
from skiros2_common.core.world_element import Element, RelationDict

#: Properties that the one-line summary of an element omits.
_MINOR = re.compile(
    r"skiros:((Position|Size|Velocity)[XYZ]|Orientation[XYZW]|(Base|LinkedTo|PushTo)?FrameId|PushToFrameId"
    r"|TfTimeStamp|PublishTf|DiscreteReasoner|Template)"
)
_POSITION = ("skiros:PositionX", "skiros:PositionY", "skiros:PositionZ")


def format_value(value: Any) -> str:
    """Formats a value: floats with up to 7 digits, other values as `str`."""
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def format_values(values: Iterable[Any]) -> str:
    return ", ".join(map(format_value, values))


def format_element(element: Element) -> str:
    """Formats an element as its id and label."""
    return f'{element.id} "{element.label}"' if element.label else element.id


def summary(element: Element) -> str:
    """Formats the position and the main properties of an element on one line."""
    parts = []
    position = [element.value_of(key) for key in _POSITION]
    if None not in position:
        parts.append(f"at ({format_values(position)})")
    for key, prop in sorted(element.property_view.items()):
        if prop.values and not _MINOR.fullmatch(key):
            parts.append(f"{local_name(key)}={format_values(prop.values)}")
    return "  ".join(parts)


def format_relation(relation: RelationDict) -> str:
    return f"{relation['src']} {relation['type']} {relation['dst']}"


def format_time(stamp: float) -> str:
    """Formats a time (s since the epoch) as local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(stamp))
