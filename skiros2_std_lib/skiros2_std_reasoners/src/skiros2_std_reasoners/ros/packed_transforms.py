"""Many transforms as one tf message, kept in serialised form.

Creating a thousand `TransformStamped` 25 times per second takes half a core. Here each transform is serialised once;
for a message, only stamps and the positions of moving frames are written.
"""

from __future__ import annotations

import struct
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tf2_msgs.msg import TFMessage

from skiros2_motion.core.geometry import Pose, Vector

_STAMP_AT = 4  # after the sequence number
_POSITION_SIZE = 24


@dataclass
class _Packed:
    """A transform: its bytes, and the offset of its pose."""

    content: bytes
    pose_at: int
    position: Vector
    velocity: Vector
    since: float
    offset: int = 0

    @property
    def moves(self) -> bool:
        return any(self.velocity)


class PackedTransforms:
    """Transforms by key, in one message. Not thread-safe."""

    def __init__(self) -> None:
        self._packed: dict[Hashable, _Packed] = {}
        self._bytes: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self._is_laid_out = False
        self._stamps: NDArray[np.intp] = _indices([], 8)
        self._moving: list[_Packed] | None = None

    def __len__(self) -> int:
        return len(self._packed)

    def put(
        self,
        key: Hashable,
        base: str,
        name: str,
        pose: Pose,
        velocity: Vector = (0.0, 0.0, 0.0),
        since: float = 0.0,
    ) -> None:
        """Sets the transform of a key.

        :param velocity: since that time (m/s, in `base`).
        :param since: the time of the pose (s).
        """
        head = b"".join((bytes(12), _text(base), _text(name)))
        content = head + struct.pack("<7d", *pose.position, *pose.orientation)
        before = self._packed.get(key)
        packed = self._packed[key] = _Packed(content, len(head), pose.position, velocity, since)
        if before is None or before.content[: before.pose_at] != head:
            self._is_laid_out = False
        elif self._is_laid_out:
            packed.offset = before.offset
            at = packed.offset + packed.pose_at
            self._bytes[at : at + 56] = np.frombuffer(content, np.uint8, 56, len(head))
        if packed.moves or (before is not None and before.moves):
            self._moving = None

    def drop(self, key: Hashable) -> None:
        """Removes a transform, if it exists."""
        if self._packed.pop(key, None) is not None:
            self._is_laid_out = False

    def message(self, stamp: Any, now: float) -> PackedMessage:
        """Returns a message of all transforms at a time.

        :param stamp: the time in the message (a ROS time).
        :param now: the same time by the clock of `since` (s).
        """
        if not self._is_laid_out:
            self._lay_out()
        if self._moving is None:
            self._list_moving()
        if self._moving:
            moved = self._positions + self._velocities * np.maximum(now - self._since, 0.0)[:, np.newaxis]
            self._bytes[self._moving_at] = moved.view(np.uint8)
        self._bytes[self._stamps] = np.frombuffer(struct.pack("<2I", stamp.secs, stamp.nsecs), np.uint8)
        return PackedMessage(self._bytes.tobytes())

    def _lay_out(self) -> None:
        offset = 4
        for packed in self._packed.values():
            packed.offset = offset
            offset += len(packed.content)
        content = struct.pack("<I", len(self._packed)) + b"".join(p.content for p in self._packed.values())
        self._bytes = np.frombuffer(content, np.uint8).copy()
        self._stamps = _indices([p.offset + _STAMP_AT for p in self._packed.values()], 8)
        self._is_laid_out = True
        self._moving = None

    def _list_moving(self) -> None:
        self._moving = [packed for packed in self._packed.values() if packed.moves]
        self._positions = np.array([p.position for p in self._moving], float)
        self._velocities = np.array([p.velocity for p in self._moving], float)
        self._since = np.array([p.since for p in self._moving], float)
        self._moving_at = _indices([p.offset + p.pose_at for p in self._moving], _POSITION_SIZE)


class PackedMessage(TFMessage):
    """A serialised `TFMessage`, for publishing only."""

    def __init__(self, content: bytes) -> None:
        super().__init__()
        self.content = content

    def serialize(self, buff: Any) -> None:
        buff.write(self.content)


class IncomingMessage(TFMessage):
    """A `TFMessage` that is deserialised on access to its transforms."""

    def __init__(self) -> None:
        self.content = b""
        self._unpacked: list[Any] | None = None

    def deserialize(self, content: bytes) -> IncomingMessage:
        self.content = content
        return self

    @property
    def transforms(self) -> list[Any]:
        if self._unpacked is None:
            self._unpacked = TFMessage().deserialize(self.content).transforms if self.content else []
        return self._unpacked


def _text(text: str) -> bytes:
    """Serialises a text for tf2, without leading slash."""
    encoded = text.lstrip("/").encode()
    return struct.pack("<I", len(encoded)) + encoded


def _indices(starts: list[int], length: int) -> NDArray[np.intp]:
    """Returns the indices of `length` bytes from each start."""
    return np.array(starts, np.intp).reshape(-1, 1) + np.arange(length)
