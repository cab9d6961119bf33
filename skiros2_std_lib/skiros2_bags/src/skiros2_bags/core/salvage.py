"""Reads truncated bags: rebuilds the missing index from the complete records.

Format: http://wiki.ros.org/Bags/Format/2.0.

`rosbag reindex` does not replace this. Of four of the recorded runs in tests/bags, cut off after 30, 60, 90 and 99 %,
it reads no message of any file: it fails at the record that is cut off and leaves no index. This reader reads all
complete records: 45 to 116, 18 to 86, 105 to 347 and 0 to 352 messages. `rosbag reindex` also changes the file, and
needs ROS.
"""

from __future__ import annotations

import os
import struct
from bz2 import BZ2Decompressor
from collections import defaultdict
from collections.abc import Callable
from io import BufferedReader, BytesIO, FileIO
from pathlib import Path, PosixPath
from typing import Any, BinaryIO

from lz4.frame import LZ4FrameDecompressor
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import (
    Chunk,
    ChunkInfo,
    Header,
    IndexData,
    RecordType,
    read_bytes,
    read_uint32,
)

#: Exceptions that reading a damaged file may raise.
DAMAGE = (ReaderError, AssertionError, EOFError, IndexError, KeyError, OSError, RuntimeError, ValueError, struct.error)


#: The largest chunk (bytes); recorders write chunks below 1 MB, and each message is within one.
MAX_CHUNK = 64 * 1024**2


def _bounded(name: str, make: Callable[[], Any]) -> Callable[[bytes], bytes]:
    """Returns a function that decompresses a chunk, which may be small and grow without end.

    :param make: makes a decompressor with `decompress(data, max_length)`.
    """

    def decompress(data: bytes) -> bytes:
        content: bytes = make().decompress(data, MAX_CHUNK + 1)
        if len(content) > MAX_CHUNK:
            raise ReaderError(f"a {name} chunk of {len(data)} bytes has more than {MAX_CHUNK} bytes")
        return content

    return decompress


_DECOMPRESSORS: dict[str, Callable[[bytes], bytes]] = {
    "none": lambda data: data,
    "bz2": _bounded("bz2", BZ2Decompressor),
    "lz4": _bounded("lz4", LZ4FrameDecompressor),
}


class _BoundedFile(BufferedReader):
    """A file that allocates no more than it has left, whatever length a damaged record asks for."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Reads up to `size` bytes."""
        left = max(os.fstat(self.fileno()).st_size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


class _BoundedPath(PosixPath):
    def open(self, *_: Any, **__: Any) -> Any:
        return _BoundedFile(FileIO(self))


class BoundedReader(Reader):
    """A reader of bags with a limit on the size of chunks and other records."""

    def __init__(self, path: Path) -> None:
        super().__init__(_BoundedPath(path))

    def read_chunk(self) -> Chunk:
        """Reads the next chunk's place."""
        assert self.bio is not None
        start = self.bio.tell()
        compression = Header.read(self.bio).get_string("compression")
        self.bio.seek(start)
        return super().read_chunk()._replace(decompressor=_decompressor(compression))


def _decompressor(compression: str) -> Callable[[bytes], bytes]:
    if compression not in _DECOMPRESSORS:
        raise ReaderError(f"Compression {compression!r} is not supported.")
    return _DECOMPRESSORS[compression]


class SalvageReader(BoundedReader):
    """A reader of bags without index. Messages after the first damaged record are lost.

    :ivar end_reason: where the complete records end (bytes), and why.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.end_reason = ""

    def open(self) -> None:
        """Opens the bag and reads it once completely."""
        self.bio = self.path.open("rb")
        try:
            if self.bio.readline() != b"#ROSBAG V2.0\n":
                raise ReaderError("it does not begin as a bag of version 2.0 does")
            self._index(self.path.stat().st_size)
        except DAMAGE:
            self.close()
            raise

    def _index(self, size: int) -> None:
        bio = self.bio
        assert bio is not None
        connections: dict[int, Connection] = {}
        indexes: dict[int, list[IndexData]] = defaultdict(list)
        while (start := bio.tell()) < size:
            try:
                header = Header.read(bio)
                operation = header.get_uint8("op")
                length = read_uint32(bio)
                data_start = bio.tell()
                if operation == RecordType.CHUNK:
                    self._read_chunk_at(start, header, min(length, size - data_start), connections, indexes)
                bio.seek(data_start + length)
                if data_start + length > size:
                    raise ReaderError("the last record is cut off")
            except DAMAGE as error:
                self.end_reason = f"after {start} of {size} bytes: {error or type(error).__name__}"
                break
        else:
            self.end_reason = f"after {size} bytes, without an index: its recorder was killed"
        self.indexes = {number: sorted(indexes[number]) for number in connections}
        self.connections = [
            connection._replace(msgcount=len(self.indexes[number])) for number, connection in connections.items()
        ]

    def _read_chunk_at(
        self,
        position: int,
        header: Header,
        length: int,
        connections: dict[int, Connection],
        indexes: dict[int, list[IndexData]],
    ) -> None:
        """Indexes the messages of a chunk; in a truncated, uncompressed chunk, the complete ones."""
        assert self.bio is not None
        data_start = self.bio.tell()
        compression = header.get_string("compression")
        chunk = Chunk(length, data_start, _decompressor(compression))
        content = chunk.decompressor(read_bytes(self.bio, length))
        times: list[int] = []
        counts: dict[int, int] = defaultdict(int)
        try:
            for number, time, offset in self._messages_in(BytesIO(content), len(content), connections):
                indexes[number].append(IndexData(time, position, offset))
                times.append(time)
                counts[number] += 1
        finally:
            self.chunks[position] = chunk
            if times:
                self.chunk_infos.append(ChunkInfo(position, min(times), max(times) + 1, dict(counts)))

    def _messages_in(self, chunk: BinaryIO, size: int, connections: dict[int, Connection]) -> Any:
        """Yields (connection, time, offset) of each message of a chunk; adds new connections to `connections`."""
        while (offset := chunk.tell()) < size:
            header = Header.read(chunk)
            if header.get_uint8("op") == RecordType.CONNECTION:
                chunk.seek(offset)
                connection = self._connection_from(chunk)
                connections.setdefault(connection.id, connection)
                continue
            number, time = header.get_uint32("conn"), header.get_time("time")
            read_bytes(chunk, read_uint32(chunk))
            if number not in connections:
                raise ReaderError(f"a message of connection {number}, which was not declared")
            yield number, time, offset

    def _connection_from(self, source: BinaryIO) -> Connection:
        """Reads the next connection record of a source."""
        file, self.bio = self.bio, source
        try:
            return self.read_connection()
        finally:
            self.bio = file
