"""Values, elements and relations as short texts, for command lines and windows."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from typing import Any

from skiros2_common.core.names import local_name
from skiros2_common.core.world_element import Element, RelationDict

#: Left out of what is told of an element on one line.
_MINOR = re.compile(
    r"skiros:((Position|Size|Velocity)[XYZ]|Orientation[XYZW]|(Base|LinkedTo|PushTo)?FrameId|PushToFrameId"
    r"|TfTimeStamp|PublishTf|DiscreteReasoner|Template)"
)
_POSITION = ("skiros:PositionX", "skiros:PositionY", "skiros:PositionZ")


def shown(value: Any) -> str:
    """A value: texts as they are, numbers in few digits."""
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def shown_values(values: Iterable[Any]) -> str:
    return ", ".join(map(shown, values))


def shown_element(element: Element) -> str:
    """An element by its id and label."""
    return f'{element.id} "{element.label}"' if element.label else element.id


def summary(element: Element) -> str:
    """The position and the main properties of an element on one line."""
    parts = []
    position = [element.value_of(key) for key in _POSITION]
    if None not in position:
        parts.append(f"at ({shown_values(position)})")
    for key, prop in sorted(element._props.items()):
        if prop.values and not _MINOR.fullmatch(key):
            parts.append(f"{local_name(key)}={shown_values(prop.values)}")
    return "  ".join(parts)


def shown_relation(relation: RelationDict) -> str:
    return f"{relation['src']} {relation['type']} {relation['dst']}"


def shown_time(stamp: float) -> str:
    """A time (s since the epoch) as local date and time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(stamp))
