"""The changes of the world model, from its messages in a bag."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from skiros2_bags.core.contract_types import MONITOR
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import Message
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.property import Property, shown
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import RESET, Change, relation_dict, snapshot_number

_TYPES: dict[str, type] = {kind.__name__: kind for kind in (str, int, float, bool, list, dict)}


@dataclass(frozen=True, eq=False)
class TimedChange:
    """A change of the world model.

    :param time: when it was recorded (s since the epoch).
    :param gap: what is missing before it; "" when it follows the one before.
    """

    time: float
    change: Change
    gap: str = ""


def timed_changes(messages: Iterable[Message]) -> list[TimedChange]:
    """The changes in the order in which they were made, which their snapshot ids tell.

    A message that came before its time waits for those before it. One whose predecessor never comes has a `gap`; so
    has the first of all when it does not tell the whole scene.

    :param messages: of the type `WmMonitor`, oldest first.
    :raises BagError: one cannot be read.
    """
    told = [(message.time, read_change(message)) for message in messages]
    return list(_in_order(told))


def read_change(message: Message) -> Change:
    """A change from its message.

    :raises BagError: it cannot be read.
    """
    content = message.content
    try:
        return change_from(content)
    except (SkirosError, ValueError, TypeError) as error:
        place = f"{message.topic} at {message.time:.3f} s"
        raise BagError(f"{place}: change {content.snapshot_id!r} cannot be read: {error}") from error


def change_from(content: Any) -> Change:
    """A change from the content of a `WmMonitor`.

    :raises SkirosError: a value is not of the type that is told.
    :raises ValueError: a value is no JSON.
    """
    number = snapshot_number(content.snapshot_id)
    return Change(
        number,
        content.prev_snapshot_id,
        content.snapshot_id,
        content.stamp.sec + content.stamp.nanosec / 1e9,
        content.author,
        content.action,
        "scene",
        tuple([_element(e, number) for e in content.elements]),
        tuple([_relation(r) for r in content.relation]),
    )


def _element(message: Any, version: int) -> Element:
    properties = {p.key: _property(p.key, p.dataValue, p.dataType) for p in message.properties}
    relations = [_relation(r) for r in message.relations]
    return Element.shared(message.type, message.label, message.id, properties, relations, version)


def _relation(message: Any) -> RelationDict:
    return relation_dict(message.subjectId, message.predicate, message.objectId)


@functools.lru_cache(maxsize=20_000)
def _property(key: str, text: str, type_name: str) -> Property:
    """A property as it travels; elements share those that are equal, and never change them.

    Values of classes that a library has registered stay as their JSON says.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"property {key!r}: {shown(text)} is no JSON list: {error}") from None
    values = values if isinstance(values, list) else [values]
    prop = Property(key, _TYPES.get(type_name, type(values[0]) if values else str))
    prop.assign(values)
    return prop


def _in_order(told: list[tuple[float, Change]]) -> Iterator[TimedChange]:
    known = ""
    waiting: dict[str, tuple[float, Change]] = {}
    coming = {change.snapshot_id for _, change in told}
    for time, change in told:
        coming.discard(change.snapshot_id)
        if change.action != RESET and change.prev_snapshot_id != known and change.prev_snapshot_id in coming:
            waiting[change.prev_snapshot_id] = (time, change)
            continue
        gap = "" if change.action == RESET or change.prev_snapshot_id == known else _gap(known, change)
        yield TimedChange(time, change, gap)
        known = change.snapshot_id
        while known in waiting:
            late, change = waiting.pop(known)
            yield TimedChange(max(time, late), change)
            known = change.snapshot_id


def _gap(known: str, change: Change) -> str:
    first = f"the {change.action} {change.snapshot_id!r} of {change.author!r}"
    if not known:
        return f"the bag does not begin with the whole scene ({MONITOR} with action {RESET!r}) but with {first}"
    return f"changes of the world model are missing between {known!r} and {change.prev_snapshot_id!r}, before {first}"
