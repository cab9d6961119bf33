"""Deserialises the progress of tasks; nodes that equal those of the previous message are reused.

rospy needs a fifth of a core for a tree of 1000 nodes at 25 Hz, of which few change. Receivers may take a node that is
the same object as before as unchanged.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from typing import Any

from genpy import DeserializationError

from skiros2_msgs import msg as msgs

#: Tasks whose last message is kept.
MAX_KEPT = 64

_UINT = struct.Struct("<I")
_THREE = struct.Struct("<hhff")  # state, code, period, time
_SHORT = struct.Struct("<h")
_TWO = struct.Struct("<hh")  # task, node

#: Raised by truncated or invalid messages.
_BROKEN = (struct.error, UnicodeDecodeError, IndexError)


#: The last message of a task: the bytes of each node, and the nodes.
_Last = tuple[list[bytes], list[Any]]


class QuickTreeProgress(msgs.TreeProgress):  # type: ignore[misc]
    """A `TreeProgress` for subscribers."""

    _known: OrderedDict[bytes, _Last] = OrderedDict()

    def deserialize(self, buff: bytes) -> QuickTreeProgress:
        try:
            self.progress = _read(bytes(buff), self._known)
        except _BROKEN as error:
            raise DeserializationError(error) from error
        return self


def _read(data: bytes, known: OrderedDict[bytes, _Last]) -> list[Any]:
    (count,) = _UINT.unpack_from(data, 0)
    if not count:
        return []
    (length,) = _UINT.unpack_from(data, 4)
    task = data[4 : 8 + length + _TWO.size]  # robot, task and node id of the first node
    old_records, old_nodes = known.pop(task, ([], []))
    records: list[bytes] = []
    nodes: list[Any] = []
    at = 4
    for i in range(count):
        if i < len(old_records):
            record = old_records[i]
            if data.startswith(record, at):
                records.append(record)
                nodes.append(old_nodes[i])
                at += len(record)
                continue
        node, end = _node(data, at)
        records.append(data[at:end])
        nodes.append(node)
        at = end
    known[task] = (records, nodes)
    while len(known) > MAX_KEPT:
        known.popitem(last=False)
    return nodes


def _node(data: bytes, at: int) -> tuple[Any, int]:
    """Returns the node at a byte offset, and the offset of its end."""
    robot, at = _text(data, at)
    task, number = _TWO.unpack_from(data, at)
    parent_label, at = _text(data, at + _TWO.size)
    (parent,) = _SHORT.unpack_from(data, at)
    kind, at = _text(data, at + _SHORT.size)
    label, at = _text(data, at)
    (count,) = _UINT.unpack_from(data, at)
    at += _UINT.size
    params = []
    for _ in range(count):
        param, at = _text(data, at)
        params.append(msgs.Param(param))
    processor, at = _text(data, at)
    state, code, period, time = _THREE.unpack_from(data, at)
    message, at = _text(data, at + _THREE.size)
    return msgs.SkillProgress(
        robot, task, number, parent_label, parent, kind, label, params, processor, state, code, period, time, message
    ), at


def _text(data: bytes, at: int) -> tuple[str, int]:
    (length,) = _UINT.unpack_from(data, at)
    at += _UINT.size
    end = at + length
    if end > len(data):
        raise IndexError(f"string of {length} bytes, but {len(data) - at} bytes remain")
    return data[at:end].decode("utf-8"), end
