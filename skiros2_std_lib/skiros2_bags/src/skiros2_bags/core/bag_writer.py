"""Writes a bag while messages arrive."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer
from rosbags.rosbag1.writer import WriterError

from skiros2_bags.core.errors import BagError
from skiros2_common.core.errors import WrongValue

COMPRESSIONS = ("none", "bz2", "lz4")

#: Messages of this type are written only when they change: action servers repeat them five times a second.
_STATUS = "actionlib_msgs/GoalStatusArray"

#: Size of sequence number and time in a `Header`; the rest of an unchanged message is the same.
_STAMP_SIZE = 12


class BagWriter:
    """Writes a bag. Not thread-safe.

    The file is named `FILE.active` until `close`. If the process is killed, `BagFile` can read that file up to the last
    `flush`.

    :param compression: one of `COMPRESSIONS`.
    :param replace: whether to replace an existing file.
    :raises WrongValue: the compression is unknown.
    :raises BagError: the file exists, or cannot be created.
    """

    def __init__(self, path: Path, compression: str = "none", replace: bool = False) -> None:
        if compression not in COMPRESSIONS:
            raise WrongValue(f"unknown compression {compression!r}, expected one of {', '.join(COMPRESSIONS)}")
        self.path = path
        self.active = path.with_name(f"{path.name}.active")
        self.count = 0
        if path.exists() and not replace:
            raise BagError(f"{path}: there is such a file already")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.active.unlink(missing_ok=True)  # left by a killed recorder
            self._writer = Writer(self.active)
            if compression != "none":
                self._writer.set_compression(Writer.CompressionFormat[compression.upper()])
            self._writer.open()
        except (OSError, WriterError) as error:
            raise BagError(f"{path}: the bag cannot be written: {error}") from error
        self._connections: dict[tuple[str, ...], Connection] = {}
        self._last_status: dict[tuple[str, ...], bytes] = {}

    def write(self, topic: str, header: Mapping[str, str], time: int, data: bytes) -> None:
        """Writes a message. Omits an action server's status that has not changed.

        :param header: of the connection: `type`, `md5sum`, `message_definition`, `callerid`, `latching`.
        :param time: ns since the epoch.
        :raises BagError: writing fails.
        """
        kind, md5, caller = header["type"], header["md5sum"], header.get("callerid", "")
        key = (topic, kind, md5, caller)
        if kind == _STATUS:
            if self._last_status.get(key) == data[_STAMP_SIZE:]:
                return
            self._last_status[key] = data[_STAMP_SIZE:]
        try:
            connection = self._connections.get(key)
            if connection is None:
                connection = self._connections[key] = self._writer.add_connection(
                    topic,
                    kind.replace("/", "/msg/"),
                    msgdef=header.get("message_definition", ""),
                    md5sum=md5,
                    callerid=caller,
                    latching=int(header.get("latching") == "1"),
                )
            self._writer.write(connection, time, data)
        except (OSError, WriterError) as error:
            raise BagError(f"{self.active}: the bag cannot be written: {error}") from error
        self.count += 1

    def flush(self) -> None:
        """Writes all messages so far to the disk.

        :raises BagError: writing fails.
        """
        try:
            chunk = self._writer.chunks[-1]
            if chunk.connections:
                self._writer.write_chunk(chunk)
            if self._writer.bio is not None:
                self._writer.bio.flush()
        except OSError as error:
            raise BagError(f"{self.active}: the bag cannot be written: {error}") from error

    def close(self) -> None:
        """Completes the bag and renames it to its final name.

        :raises BagError: writing fails.
        """
        try:
            self._writer.close()
            os.replace(self.active, self.path)
        except OSError as error:
            raise BagError(f"{self.path}: the bag cannot be ended: {error}; see {self.active}") from error
