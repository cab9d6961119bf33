"""The log of the newest requests of a journal: they are on disk, but not in the tables yet.

A request is a line of the log, written by one call of the operating system before the request is acknowledged: the
end of the process loses none. A thread merges the lines of 20 ms into the tables in one transaction. Before, each
request was a transaction of its own, which writes four pages: 50 µs of CPU, while the request held the lock of the
world model and its client waited. A line takes 2 µs, and the rows of a request in a larger transaction 25 µs.

The log is a file beside the journal, not a table of it: SQLite has one writer, so that requests would wait for merges.
"""

from __future__ import annotations

import json
import logging
import os
import sqlite3
import threading
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from skiros2_common.core.changeset import ChangeInfo, record_json
from skiros2_common.core.errors import Refused
from skiros2_world_model.core.journal_file import JournalFile
from skiros2_world_model.core.scene import Scene

log = logging.getLogger(__name__)

#: How long requests wait to be merged, so that one transaction has several of them (s).
_DELAY = 0.02
#: The number of waiting requests, and the size of the log (bytes), at which further requests wait for a merge.
_MAX_WAITING, _MAX_SIZE = 5000, 1 << 23


class RequestPart(NamedTuple):
    """The changes of a request in one context.

    :param number, last: the numbers of its first and last change.
    :param next_number: the lowest unused id number of the context.
    :param elements: by id, the content of added and changed elements as `record_json`; None: removed.
    :param relations: subject, predicate, object, and whether the relation was added (or removed).
    :param touched: elements of which only relations have changed.
    """

    number: int
    last: int
    stamp: float
    author: str
    context: str
    next_number: int
    elements: list[tuple[str, str | None]]
    relations: list[tuple[str, str, str, bool]]
    touched: list[str]

    @staticmethod
    def of(change_info: ChangeInfo, last: int, context: str, scene: Scene) -> RequestPart:
        """The part of a request that a scene has, but has not committed."""
        changes = scene.changes
        return RequestPart(
            *(change_info.version, last, change_info.stamp, change_info.author, context, scene.next_number),
            [(eid, None if after is None else record_json(after)) for eid, (_, after) in changes.records.items()],
            [(*relation, added) for relation, added in changes.relations.items()],
            [eid for eid in changes.ids() if eid not in changes.records and eid in scene] if changes.relations else [],
        )


class LogLine(NamedTuple):
    """A request as a line of the log, without the number of the request before it."""

    parts: list[RequestPart]
    text: str

    @staticmethod
    def of(parts: Iterable[tuple[ChangeInfo, int, str, Scene]]) -> LogLine:
        """Encodes a request.

        :param parts: the arguments of `RequestPart.of` for each part.
        :raises Refused: a text of it is not Unicode.
        """
        found = [RequestPart.of(*part) for part in parts]
        try:
            text = _encode(found)
            text.encode()
        except ValueError as error:
            raise Refused(f"the request cannot be written to the journal: {error}; it is refused") from error
        return LogLine(found, text)


Merge = Callable[[sqlite3.Connection, Sequence[Sequence[RequestPart]]], None]

_encode = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), check_circular=False).encode


class RequestLog:
    """The log beside a journal, and the thread that merges it.

    With the journal's `full_sync`, each `append` ends with a sync to disk. `append` and `note` are called by one thread
    at a time.

    :param merge: writes requests to the tables.
    """

    def __init__(self, file: JournalFile, merge: Merge) -> None:
        self._file = file
        self._merge = merge
        self._fd = -1
        self._size = 0
        self._newest = 0  # the number of the last request
        self._waiting: list[list[RequestPart]] = []
        self._appending = threading.Lock()  # of the log
        self._merging = threading.Lock()  # taken first
        self._failed = False
        self._wake, self._stopped = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="journal merge", daemon=True)

    def recover(self) -> None:
        """Opens the file, merges what a killed process has left, and starts the thread. Call it first.

        After a power failure, the log may continue a state that the tables have lost: such a part is discarded.

        :raises Refused: the journal cannot be written.
        """
        path = Path(f"{self._file.path}-log")
        self._fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        self._size = os.fstat(self._fd).st_size
        newest = self._file.writer.execute("SELECT max(number) FROM request").fetchone()[0] or 0
        for before, parts in _read(path):
            if parts[0].number <= newest:
                continue  # it was merged
            if before != newest:
                log.warning("journal %s: changes from %s on are lost", self._file.path, parts[0].number)
                break
            self._waiting.append(parts)
            newest = parts[-1].number
        self._newest = newest
        self.merge()
        self._thread.start()

    def append(self, lines: Sequence[LogLine]) -> None:
        """Writes requests, all or none, with one sync.

        Does not wait for the tables, unless the last merge has failed or too many requests wait.

        :raises Refused: the log cannot be written.
        """
        if self._failed or len(self._waiting) >= _MAX_WAITING:
            self.merge()
        newest, content = self._newest, b""
        for line in lines:
            text = f"[{newest},{line.text}]".encode()
            content += b"%08x %s\n" % (zlib.crc32(text), text)
            newest = line.parts[-1].number
        try:
            with self._appending:
                self._write(content)
                self._size += len(content)
                self._waiting += [line.parts for line in lines]
        except OSError as error:
            raise Refused(f"journal {self._file.path} cannot be written: {error}; the request is refused") from error
        self._newest = newest
        if not self._wake.is_set():
            self._wake.set()

    def note(self, number: int) -> None:
        """Notes the number of a request that was written to the tables directly, after a `merge`."""
        self._newest = number

    def merge(self) -> None:
        """Writes the waiting requests to the tables; blocks until all that were appended before are there. Any thread.

        :raises Refused: the journal cannot be written. The requests stay in the log.
        """
        with self._merging:
            self._merge_waiting()
            with self._appending:
                if self._size > _MAX_SIZE:  # under load, there is always a waiting one
                    self._merge_waiting()
                if self._size and not self._waiting:
                    os.ftruncate(self._fd, 0)
                    self._size = 0

    def close(self) -> None:
        """Ends the thread and closes the file. Waiting requests stay in the log."""
        self._stopped.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._merging, self._appending:
            if self._fd >= 0:
                os.close(self._fd)
            self._fd = -1

    def _write(self, content: bytes) -> None:
        if self._fd < 0:
            raise OSError("it is closed")
        try:
            if os.pwrite(self._fd, content, self._size) < len(content):
                raise OSError("no space left")
            if self._file.full_sync:
                os.fdatasync(self._fd)
        except OSError:
            with suppress(OSError):  # else the next one is written over it
                os.ftruncate(self._fd, self._size)
            raise

    def _merge_waiting(self) -> None:
        requests = self._waiting[:]  # others are appended meanwhile
        if requests:
            try:
                with self._file.transaction() as db:
                    self._merge(db, requests)
            except Refused:
                self._failed = True
                raise
            del self._waiting[: len(requests)]
        self._failed = False

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._wake.wait()
            if not self._stopped.wait(_DELAY):
                self._wake.clear()
                try:
                    self.merge()
                except Refused as error:
                    log.error("journal %s: changes wait in its log: %s", self._file.path, error.__cause__)


def _read(path: Path) -> list[tuple[int, list[RequestPart]]]:
    """Reads the requests of a log up to its end or the first damaged line, each with the number of that before it."""
    found: list[tuple[int, list[RequestPart]]] = []
    for line in path.read_bytes().split(b"\n"):
        checksum, _, text = line.partition(b" ")
        if b"%08x" % zlib.crc32(text) != checksum:
            break
        before, parts = json.loads(text)
        found.append((before, [RequestPart(*part) for part in parts]))
    return found
