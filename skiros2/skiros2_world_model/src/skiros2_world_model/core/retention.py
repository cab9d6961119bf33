"""Checkpoints a journal and prunes its oldest past states, in a background thread."""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
import time
from contextlib import closing

from skiros2_world_model.core.journal_file import LOG_LIMIT, JournalFile, read_meta

log = logging.getLogger(__name__)

#: The period of checks (s).
_PERIOD = 5.0
#: A check also runs after this number of requests.
_REQUESTS = 1000
#: The number of rows deleted in one transaction; a request never waits for more.
_ROWS = 200
#: The pause between two such transactions (s), which gives requests precedence.
_PAUSE = 0.01
#: When the journal is too large, one in this number of requests is pruned, repeatedly.
_PART = 10

#: Selects the rows before a request: table, order, condition. The last row of past_element stays, so that its rowids
#: keep increasing.
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


class Retention:
    """The background thread that keeps a journal within its limits.

    :param days: the retention period (days); 0: unlimited.
    :param max_bytes: the maximum size of the content.
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
        """Starts the thread. The first check runs immediately, as a killed process leaves a write-ahead log."""
        self.count_request()
        self._wake.set()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread and waits for its end."""
        self._stopped.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def count_request(self) -> None:
        """Counts a written request."""
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
                    self.prune()
                except (sqlite3.Error, OSError) as error:
                    log.error("journal %s: retention failed: %s", self._file.path, error)

    def prune(self) -> None:
        """Checkpoints the write-ahead log, prunes expired states, then the oldest ones until the size fits."""
        with closing(self._file.connect()) as db:
            db.execute("PRAGMA wal_checkpoint(PASSIVE)")
            if os.path.getsize(f"{self._file.path}-wal") > LOG_LIMIT:
                with self._file.writing:  # under load, a passive checkpoint never completes
                    db.execute("PRAGMA wal_checkpoint(RESTART)")
            if self._days:
                self._prune_before(db, _request_at(db, time.time() - self._days * 86400.0))
            while not self._stopped.is_set() and _size(db) > self._max_bytes:
                count = db.execute("SELECT count(*) FROM request").fetchone()[0]
                if count < 2:
                    return  # only the current state is left
                part = (max(count // _PART, 1),)
                begin = db.execute("SELECT number FROM request ORDER BY number LIMIT 1 OFFSET ?", part).fetchone()
                self._prune_before(db, begin[0])

    def _prune_before(self, db: sqlite3.Connection, begin: int) -> None:
        """Deletes all states before the one after a request, in small transactions."""
        if read_meta(db, "begin") != begin:
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
    """The number of the last request before a time; of the first request when there is none."""
    newer = db.execute("SELECT number FROM request WHERE stamp >= ? ORDER BY number LIMIT 1", (stamp,)).fetchone()
    before = "SELECT number FROM request WHERE number < ? ORDER BY number DESC LIMIT 1"
    found = db.execute(before, newer if newer is not None else (1 << 62,)).fetchone() or newer
    return int(found[0]) if found is not None else 0


def _size(db: sqlite3.Connection) -> int:
    """The size of the content (bytes), without the free pages of the file."""
    pages, free, size = (db.execute(f"PRAGMA {n}").fetchone()[0] for n in ("page_count", "freelist_count", "page_size"))
    return int((pages - free) * size)
