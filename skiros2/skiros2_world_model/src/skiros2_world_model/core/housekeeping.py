"""Keeps a journal small, beside the requests: its log goes into the database, and the oldest of the past is dropped."""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
import time
from contextlib import closing

from skiros2_world_model.core.journal_file import LOG_LIMIT, JournalFile, read_note

log = logging.getLogger(__name__)

#: How often it looks, at least (s).
_PERIOD = 5.0
#: After so many requests it looks at once.
_REQUESTS = 1000
#: Of the past, so many rows are dropped at a time; a request waits for no more.
_ROWS = 200
#: The pause between two such steps (s), so that requests go first.
_PAUSE = 0.01
#: When there is too much, this part of the requests is forgotten, and so on until there is room.
_PART = 10

#: What is before the number of a request: table, order, which. Of past_element the last row stays, so that the numbers
#: of its rows only ever grow.
_OLD = (
    (
        "past_element",
        "rowid",
        "rowid < (SELECT max(rowid) FROM past_element)"
        " AND rowid <= (SELECT past FROM request WHERE number < ? ORDER BY number DESC LIMIT 1)",
    ),
    ("past_relation", "until", "until < ?"),
    ("past_statement", "until", "until < ?"),
    ("request", "number", "number < ?"),
)


class Housekeeping:
    """A thread beside the one that writes.

    :param days: how long the past is kept; 0: without end.
    :param max_bytes: how much the journal may hold.
    """

    def __init__(self, file: JournalFile, days: float, max_bytes: int) -> None:
        self._file = file
        self._days = days
        self._max_bytes = max_bytes
        self._requests = 0
        self._wake = threading.Event()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Starts the thread. It looks at once: what was killed has left its log."""
        self.count_request()
        self._wake.set()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread, and waits for it."""
        self._stopped.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def count_request(self) -> None:
        """One more request was written."""
        self._requests += 1
        if self._requests == _REQUESTS:
            self._wake.set()

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._wake.wait(_PERIOD)
            self._wake.clear()
            if self._requests and not self._stopped.is_set():
                self._requests = 0
                try:
                    self.tidy()
                except (sqlite3.Error, OSError) as error:
                    log.error("journal %s: housekeeping failed: %s", self._file.path, error)

    def tidy(self) -> None:
        """Brings the log into the database and drops what is too old, then the oldest until there is room."""
        with closing(self._file.connect()) as beside:
            beside.execute("PRAGMA wal_checkpoint(PASSIVE)")
            if os.path.getsize(f"{self._file.path}-wal") > LOG_LIMIT:
                with self._file.writing:  # under load there is always something left
                    beside.execute("PRAGMA wal_checkpoint(RESTART)")
            if self._days:
                self._forget_before(beside, _request_at(beside, time.time() - self._days * 86400.0))
            while not self._stopped.is_set() and _size(beside) > self._max_bytes:
                count = beside.execute("SELECT count(*) FROM request").fetchone()[0]
                if count < 2:
                    return  # the present alone
                part = (max(count // _PART, 1),)
                begin = beside.execute("SELECT number FROM request ORDER BY number LIMIT 1 OFFSET ?", part).fetchone()
                self._forget_before(beside, begin[0])

    def _forget_before(self, beside: sqlite3.Connection, begin: int) -> None:
        """The history begins with the state after that request. What was before is dropped in small steps."""
        if read_note(beside, "begin") != begin:
            self._write("INSERT OR REPLACE INTO meta VALUES ('begin', ?)", begin)
        for table, order, old in _OLD:
            rows = f"SELECT rowid FROM {table} WHERE {old} ORDER BY {order} LIMIT {_ROWS}"
            while self._write(f"DELETE FROM {table} WHERE rowid IN ({rows})", begin) == _ROWS:
                if self._stopped.wait(_PAUSE):
                    return

    def _write(self, statement: str, value: int) -> int:
        with self._file.writing:
            return self._file.writer.execute(statement, (value,)).rowcount


def _request_at(db: sqlite3.Connection, stamp: float) -> int:
    """The number of the last request before that time; of the first one when there is none."""
    newer = db.execute("SELECT number FROM request WHERE stamp >= ? ORDER BY number LIMIT 1", (stamp,)).fetchone()
    before = "SELECT number FROM request WHERE number < ? ORDER BY number DESC LIMIT 1"
    found = db.execute(before, newer if newer is not None else (1 << 62,)).fetchone() or newer
    return int(found[0]) if found is not None else 0


def _size(db: sqlite3.Connection) -> int:
    """How much the journal holds (bytes). The file has room for more when some was dropped."""
    pages, free, size = (db.execute(f"PRAGMA {n}").fetchone()[0] for n in ("page_count", "freelist_count", "page_size"))
    return int((pages - free) * size)
