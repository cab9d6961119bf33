"""The changes of the world model in a bag, and the scene at any time.

The contract fixes the layout of `WmMonitor`. Parsing it directly, without an object per field, is several times faster
for a long history. Values are JSON strings with a length prefix. Most properties repeat between elements, so parsed
properties are cached by their bytes.
"""

from __future__ import annotations

import gc
import json
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from skiros2_bags.core.bag_file import MONITOR, BagError, Message, check_md5
from skiros2_common.core.element_content import relation_dict
from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.operations import RESET, SCENE, Change, snapshot_number
from skiros2_common.core.property import Property, format_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene


@dataclass(frozen=True, eq=False)
class TimedChange:
    """A change of the world model.

    :param time: when it was recorded (s since the epoch).
    :param gap: describes the changes missing before this one; "" if it continues the previous change.
    """

    time: float
    change: Change
    gap: str = ""


def timed_changes(messages: Iterable[Message]) -> list[TimedChange]:
    """Returns the changes in the order given by their snapshot ids.

    A change that was recorded before its predecessor is moved behind it. A change whose predecessor is missing has a
    `gap`; so has the first change if it is not the whole scene.

    :param messages: of the type `WmMonitor`, oldest first.
    :raises BagError: a message cannot be read.
    """
    with gc_paused():
        received = [(message.time, read_change(message)) for message in messages]
        return list(_in_order(received))


def read_change(message: Message) -> Change:
    """Decodes a change.

    :raises BagError: the message cannot be read.
    """
    check_md5(message)
    try:
        return change_from(message.data)
    except (SkirosError, ValueError, TypeError, struct.error) as error:
        raise BagError(f"{message.location}: the change cannot be read: {error}") from error


def _in_order(received: list[tuple[float, Change]]) -> Iterator[TimedChange]:
    known = ""
    waiting: dict[str, tuple[float, Change]] = {}
    pending = {change.snapshot_id for _, change in received}
    for time, change in received:
        pending.discard(change.snapshot_id)
        if change.action != RESET and change.prev_snapshot_id != known and change.prev_snapshot_id in pending:
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


def world_at(changes: Sequence[TimedChange], at: float, partial: bool = False) -> Scene:
    """Returns a new scene with all changes that were recorded up to a time.

    :param changes: in order.
    :param at: s since the epoch.
    :param partial: whether missing changes are accepted.
    :raises BagError: no change was recorded until then, or changes are missing and `partial` is False.
    """
    past = [timed for timed in changes if timed.time <= at]
    if not past:
        raise BagError(f"the bag holds no change of the world model until {at:.3f} s")
    begin = max((i for i, timed in enumerate(past) if timed.change.action == RESET), default=0)
    gap = next((timed for timed in past[begin:] if timed.gap), None)
    if gap is not None and not partial:
        raise BagError(f"the world at {at:.3f} s is not known, as at {gap.time:.3f} s {gap.gap}")
    scene = Scene()
    with gc_paused():
        for timed in past[begin:]:
            apply_change(scene, timed.change)
    return scene


@contextmanager
def gc_paused() -> Iterator[None]:
    """Disables the garbage collector: for work that creates many long-lived objects."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


_length = struct.Struct("<I").unpack_from
_stamp = struct.Struct("<II").unpack_from
_read_json = json.JSONDecoder().decode

_TYPES: dict[str, type] = {kind.__name__: kind for kind in (str, int, float, bool, list, dict)}

#: Parsed properties by their bytes. Elements share them and never modify them.
_cache: dict[bytes, Property] = {}
_CACHE_SIZE = 50_000


def change_from(data: bytes) -> Change:
    """Parses a serialised `WmMonitor`.

    :raises struct.error: the data is too short.
    :raises ValueError: a text is not UTF-8, or a value is not JSON.
    :raises SkirosError: a value does not have its declared type, or the data is too long.
    """
    before, at = _text(data, 0)
    snapshot_id, at = _text(data, at)
    seconds, nanoseconds = _stamp(data, at)
    author, at = _text(data, at + 8)
    action, at = _text(data, at)
    number = snapshot_number(snapshot_id)
    (count,) = _length(data, at)
    at += 4
    elements = []
    for _ in range(count):
        element, at = _element(data, at, number)
        elements.append(element)
    relations, at = _relations(data, at)
    if at != len(data):
        raise WrongValue(f"a WmMonitor of {at} bytes, got {len(data)}")
    stamp = seconds + nanoseconds / 1e9
    return Change(number, before, snapshot_id, stamp, author, action, SCENE, tuple(elements), tuple(relations))


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = at + 4 + _length(data, at)[0]
    return data[at + 4 : end].decode(), end


def _element(data: bytes, at: int, version: int) -> tuple[Element, int]:
    eid, at = _text(data, at)
    etype, at = _text(data, at)
    label, at = _text(data, at)
    (count,) = _length(data, at)
    at += 4
    properties = {}
    for _ in range(count):
        start = at
        at += 4 + _length(data, at)[0]
        at += 4 + _length(data, at)[0]
        at += 4 + _length(data, at)[0]
        content = data[start:at]
        prop = _cache.get(content)
        if prop is None:
            prop = _property(content)
        properties[prop.key] = prop
    relations, at = _relations(data, at)
    return Element.shared(etype, label, eid, properties, relations, version), at


def _relations(data: bytes, at: int) -> tuple[list[RelationDict], int]:
    (count,) = _length(data, at)
    at += 4
    relations = []
    for _ in range(count):
        src, at = _text(data, at)
        pred, at = _text(data, at)
        dst, at = _text(data, at)
        relations.append(relation_dict(src, pred, dst))
    return relations, at


def _property(content: bytes) -> Property:
    """Parses a property. Values of registered classes remain as decoded JSON."""
    key, at = _text(content, 0)
    text, at = _text(content, at)
    type_name, _ = _text(content, at)
    try:
        values = _read_json(text)
    except (ValueError, RecursionError) as error:
        raise WrongValue(f"property {key!r}: {format_value(text)} is not a JSON list: {error}") from None
    if not isinstance(values, list):
        values = [values]
    kind = _TYPES.get(type_name, type(values[0]) if values else str)
    if values and type(values[0]) is kind:
        prop = Property(key, values)
    else:
        prop = Property(key, kind)
        prop.assign(values)
    if len(_cache) >= _CACHE_SIZE:
        _cache.clear()
    _cache[content] = prop
    return prop
