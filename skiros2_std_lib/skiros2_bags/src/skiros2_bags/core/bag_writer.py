"""Writing a bag while messages come."""

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

#: What is not told again while it stays the same: servers of actions repeat it five times a second.
_STATUS = "actionlib_msgs/GoalStatusArray"

#: Where the content of a message with a `Header` begins that is the same as before: behind number and time.
_BEHIND_STAMP = 12


class BagWriter:
    """Writes a bag; one thread at a time.

    Until `close` the file is called `FILE.active`. When the process is killed, what is there can be read (`BagFile`);
    it is at most as old as the last `flush`.

    :param path: the file.
    :param compression: one of `COMPRESSIONS`.
    :param replace: whether a file that is there already is replaced.
    :raises WrongValue: the compression is unknown.
    :raises BagError: the file is there, or cannot be made.
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
            self.active.unlink(missing_ok=True)  # of a recorder that was killed
            self._writer = Writer(self.active)
            if compression != "none":
                self._writer.set_compression(Writer.CompressionFormat[compression.upper()])
            self._writer.open()
        except (OSError, WriterError) as error:
            raise BagError(f"{path}: the bag cannot be written: {error}") from error
        self._connections: dict[tuple[str, ...], Connection] = {}
        self._told: dict[tuple[str, ...], bytes] = {}

    def write(self, topic: str, header: Mapping[str, str], time: int, data: bytes) -> None:
        """Writes a message. A status of an action server that is as it was is left out.

        :param header: of the connection: `type`, `md5sum`, `message_definition`, `callerid`, `latching`.
        :param time: ns since the epoch.
        :raises BagError: the disk does not take it.
        """
        kind, md5, caller = header["type"], header["md5sum"], header.get("callerid", "")
        key = (topic, kind, md5, caller)
        if kind == _STATUS:
            if self._told.get(key) == data[_BEHIND_STAMP:]:
                return
            self._told[key] = data[_BEHIND_STAMP:]
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
        """Gives what was written so far to the disk.

        :raises BagError: the disk does not take it.
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
        """Ends the bag and gives it its name.

        :raises BagError: the disk does not take it.
        """
        try:
            self._writer.close()
            os.replace(self.active, self.path)
        except OSError as error:
            raise BagError(f"{self.path}: the bag cannot be ended: {error}; see {self.active}") from error
