"""A recording in several bags, each of which can be read alone."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from pathlib import Path

from skiros2_bags.core.bag_file import MONITOR
from skiros2_bags.core.bag_writer import PARAMETERS, BagWriter


class BagParts:
    """Writes bags of a largest size: `run.bag`, `run_2.bag`, ... Not thread-safe.

    A new part begins with the latched messages so far, except for changes of the world model, which its caller begins
    again with the whole scene.

    :param compression, replace: see `BagWriter`.
    :param most_bytes: the size of the messages in a part, uncompressed; 0: unlimited.
    :param keep: the number of parts to keep, the newest; 0: all.
    :raises WrongValue, BagError: see `BagWriter`.
    :ivar part: the number of the current part, from 1.
    """

    def __init__(
        self, path: Path, compression: str = "none", replace: bool = False, most_bytes: int = 0, keep: int = 0
    ) -> None:
        self._path = path
        self._compression = compression
        self._replace = replace
        self._most_bytes = most_bytes
        self._keep = keep
        self._size = 0
        self._earlier: deque[Path] = deque()
        self._count = 0
        self._latched: dict[tuple[str, str], tuple[Mapping[str, str], bytes]] = {}
        self.part = 1
        self._writer = BagWriter(path, compression, replace)

    @property
    def path(self) -> Path:
        """The current part."""
        return self._writer.path

    @property
    def count(self) -> int:
        """The number of messages in all parts."""
        return self._count + self._writer.count

    def write(self, topic: str, header: Mapping[str, str], time: int, data: bytes) -> None:
        """Writes a message; see `BagWriter.write`."""
        if self._most_bytes and self._size + len(data) > self._most_bytes and self._size:
            self._next_part(time)
        self._size += len(data)
        if topic == PARAMETERS or (header.get("latching") == "1" and header["type"] != MONITOR):
            self._latched[topic, header.get("callerid", "")] = header, data
        self._writer.write(topic, header, time, data)

    def flush(self) -> None:
        """Writes all messages so far to the disk."""
        self._writer.flush()

    def close(self) -> None:
        """Completes the current part."""
        self._writer.close()

    def _next_part(self, time: int) -> None:
        self._writer.close()
        self._count += self._writer.count
        self._earlier.append(self._writer.path)
        while self._keep and len(self._earlier) >= self._keep:
            self._earlier.popleft().unlink(missing_ok=True)
        self.part += 1
        name = f"{self._path.stem}_{self.part}{self._path.suffix}"
        self._writer, self._size = BagWriter(self._path.with_name(name), self._compression, self._replace), 0
        for (topic, _), (header, data) in self._latched.items():
            self._writer.write(topic, header, time, data)
