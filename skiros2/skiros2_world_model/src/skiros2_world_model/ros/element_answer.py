"""Answers with elements and changes, whose bytes are made once for each state of an element, and for each change.

The message of an element with seven properties takes 13 µs, and its serialization by the generated code 10 µs: for many
elements, that is most of what an answer takes beyond a bare service. A state of an element is identified by its
context, its id and the number of its last change, which also counts changes of its relations: its bytes are kept.
A change goes to its author and to all subscribers of the monitor topic, with these bytes.

The messages below have the fields of the generated classes; lists that are passed as bytes stay empty.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import genpy

from skiros2_common.core.operations import Change
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import element2msg, relation2msg
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs

#: The number of elements whose bytes are kept.
MAX_KEPT = 10_000


class ElementAnswer(srvs.WmGetResponse):  # type: ignore[misc]
    """A `WmGetResponse` for sending.

    :param snapshot_id: of the world model.
    :param parts: the bytes of the elements.
    """

    def __init__(self, snapshot_id: str, parts: Sequence[bytes]) -> None:
        super().__init__(snapshot_id, [])
        self._parts = parts

    def serialize(self, buff: Any) -> None:
        buff.write(_with_list(super(), self._parts))


class ModifyAnswer(srvs.WmModifyResponse):  # type: ignore[misc]
    """A `WmModifyResponse` for sending.

    :param parts: the bytes of the elements.
    """

    def __init__(self, parts: Sequence[bytes]) -> None:
        super().__init__([])
        self._parts = parts

    def serialize(self, buff: Any) -> None:
        buff.write(_with_list(super(), self._parts))


class TransactionAnswer(srvs.WmTransactionResponse):  # type: ignore[misc]
    """A `WmTransactionResponse` for sending.

    :param ids: of the response.
    :param changes: its changes.
    """

    def __init__(self, ids: Sequence[str], changes: Sequence[ChangeMessage]) -> None:
        super().__init__(ids, [])
        self._parts = [change.data for change in changes]

    def serialize(self, buff: Any) -> None:
        buff.write(_with_list(super(), self._parts))


class ChangeMessage(msgs.WmMonitor):  # type: ignore[misc]
    """A `WmMonitor` for sending.

    :param parts: the bytes of the elements.
    """

    def __init__(self, change: Change, parts: Sequence[bytes]) -> None:
        names = change.prev_snapshot_id, change.snapshot_id, genpy.Time.from_sec(change.stamp), change.author
        super().__init__(*names, change.action, [], [])
        relations = srvs.WmQueryRelationsResponse([relation2msg(relation) for relation in change.relations])
        own = _bytes(super())[:-8]  # without the lengths of `elements` and `relation`
        self.data = b"".join((own, struct.pack("<I", len(parts)), *parts, _bytes(relations)))

    def serialize(self, buff: Any) -> None:
        buff.write(self.data)


def _bytes(message: Any) -> bytes:
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def _with_list(message: Any, parts: Sequence[bytes]) -> bytes:
    """The bytes of a message, with the parts of its last field, which is an empty list."""
    return b"".join((_bytes(message)[:-4], struct.pack("<I", len(parts)), *parts))


class ElementBytes:
    """The bytes of elements as `WmElement` messages. Thread-safe."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str], tuple[int, bytes]] = {}

    def of(self, element: Element, context: str) -> bytes:
        """Returns the bytes of an element that the world model has returned.

        :param context: its context; "": not known, nothing is kept.
        """
        key = context, element.id
        kept = self._kept.get(key)
        if kept is not None and kept[0] == element.version:
            return kept[1]
        data = _bytes(element2msg(element))
        if context and element.id and element.version > 0:
            if len(self._kept) >= MAX_KEPT:
                self._kept.clear()
            self._kept[key] = element.version, data
        return data
