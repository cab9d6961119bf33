"""Parses changes of the world model from serialised messages.

The contract fixes the layout of `WmMonitor`. Parsing it directly, without an object per field, is several times faster
for a long history. Values are JSON strings with a length prefix. Most properties repeat between elements, so parsed
properties are cached by their bytes.
"""

from __future__ import annotations

import json
import struct

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import Property, format_value
from skiros2_common.core.world_element import Element, RelationDict
from skiros2_world_model.core.changes import Change, relation_dict, snapshot_number

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
    return Change(number, before, snapshot_id, stamp, author, action, "scene", tuple(elements), tuple(relations))


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
        raise WrongValue(f"property {key!r}: {format_value(text)} is no JSON list: {error}") from None
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
