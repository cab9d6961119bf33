"""The file of the journal: an SQLite database with one writing server and any number of readers.

Each table holds the current state. Its counterpart `past_...` holds rows that were valid from the request `since`
(inclusive) to the request `until` (exclusive), so that one query returns a past state or the changes of a request.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_common.core.file_lock import own_file

log = logging.getLogger(__name__)

_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value);
-- number, last: the numbers of its first and last change; past: the highest rowid of past_element at that time
CREATE TABLE request (number INTEGER PRIMARY KEY, last INTEGER, stamp REAL, author TEXT, action TEXT, context TEXT,
    past INTEGER);
-- next_number: the lowest unused id number
CREATE TABLE context (name TEXT PRIMARY KEY, file TEXT, next_number INTEGER);
-- made, stamp, author: the number, time and author of the last change of the element or of one of its relations
CREATE TABLE element (context TEXT, id TEXT, since INTEGER, made INTEGER, stamp REAL, author TEXT, content TEXT);
CREATE UNIQUE INDEX element_id ON element (context, id);
-- rows are inserted in the order of until, see request.past
CREATE TABLE past_element (until INTEGER, context TEXT, id TEXT, since INTEGER, content TEXT);
CREATE INDEX past_element_id ON past_element (context, id);
CREATE TABLE relation (context TEXT, src TEXT, pred TEXT, dst TEXT, since INTEGER);
CREATE UNIQUE INDEX relation_ends ON relation (context, src, pred, dst);
CREATE TABLE past_relation (until INTEGER, context TEXT, src TEXT, pred TEXT, dst TEXT, since INTEGER);
CREATE INDEX past_relation_until ON past_relation (until);
-- triples outside elements, as N-Triples; of the ontologies only the differences from their files, where present = 0
-- means removed
CREATE TABLE statement (context TEXT, triple TEXT, present INTEGER, since INTEGER);
CREATE UNIQUE INDEX statement_triple ON statement (context, triple);
CREATE TABLE past_statement (until INTEGER, context TEXT, triple TEXT, present INTEGER, since INTEGER);
CREATE INDEX past_statement_until ON past_statement (until);
"""
#: Added later; a journal without them gets them.
_MORE_INDEXES = """
CREATE INDEX IF NOT EXISTS past_relation_src ON past_relation (context, src, until);
CREATE INDEX IF NOT EXISTS past_relation_dst ON past_relation (context, dst, until);
"""
_APPLICATION = 0x534B5232  # "SKR2"
_VERSION = 1

#: Smaller than SQLite's default (bytes), because a request changes few rows on many pages and writes whole pages.
_PAGE_SIZE = 2048
#: The size to which the write-ahead log is truncated after a checkpoint (bytes).
LOG_LIMIT = 1 << 26


class JournalFile:
    """The database, opened for writing. Hold `writing` while using the connection `writer`.

    A killed process loses no committed transaction. With `full_sync`, a power failure loses none either.

    :param path: created, with its folder, when it does not exist. A damaged or foreign file is moved aside.
    :param full_sync: syncs every commit to disk.
    :param timeout: how long to wait for the end of another server (s); None: some seconds.
    :raises ConfigurationError: another server uses the journal, or it cannot be created.
    """

    def __init__(self, path: Path, full_sync: bool = False, timeout: float | None = None) -> None:
        self.path = path
        self.writing = threading.Lock()
        self.full_sync = full_sync
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = own_file(path, timeout)
        except OSError as error:
            raise ConfigurationError(f"journal {path}: {error.strerror or error}") from None
        try:
            self.writer = self._open()
        except sqlite3.OperationalError as error:
            self._lock.close()
            raise ConfigurationError(f"journal {path}: {error}") from None
        except sqlite3.DatabaseError as error:
            self.writer = self._move_aside(error)

    def set_full_sync(self, full_sync: bool) -> None:
        """Syncs every further commit to disk, or no longer; those before are synced at once. Any thread.

        :raises Refused: the journal cannot be written.
        """
        with self.writing:
            self.full_sync = full_sync
            self.writer.execute(self._synchronous)
        if full_sync:
            with self.transaction() as db:
                db.execute("UPDATE meta SET value=value WHERE key='state'")

    @property
    def _synchronous(self) -> str:
        return f"PRAGMA synchronous={'FULL' if self.full_sync else 'NORMAL'}"

    def check(self) -> None:
        """Checks the integrity of the tables with the current state.

        Those of the past grow with the history: a million requests would take most of a second. Reading them reports
        their damage.

        :raises sqlite3.DatabaseError: the file is damaged.
        """
        for table in ("meta", "context", "element", "relation", "statement"):
            found = self.writer.execute(f"PRAGMA quick_check({table})").fetchone()[0]
            if found != "ok":
                raise sqlite3.DatabaseError(found)

    def start_over(self, cause: Exception) -> None:
        """Moves the file aside and creates an empty one."""
        self.writer.close()
        self.writer = self._move_aside(cause)

    def connect(self) -> sqlite3.Connection:
        """Opens another connection."""
        return sqlite3.connect(self.path, isolation_level=None, check_same_thread=False)

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """A transaction, which is committed at the end of the block, or rolled back on an exception.

        :raises Refused: the journal cannot be written.
        """
        try:
            with self.writing:
                db = self.writer
                db.execute("BEGIN IMMEDIATE")
                try:
                    yield db
                    db.execute("COMMIT")
                finally:
                    if db.in_transaction:
                        db.execute("ROLLBACK")
        except (sqlite3.Error, UnicodeError) as error:
            raise Refused(f"journal {self.path} cannot be written: {error}; the request is refused") from error

    def close(self) -> None:
        """Closes the file and releases the lock on it."""
        self.writer.close()
        self._lock.close()

    def _move_aside(self, cause: Exception) -> sqlite3.Connection:
        aside = f"{self.path}.damaged-{time.strftime('%Y%m%d-%H%M%S')}"
        for ending in ("", "-wal", "-shm", "-log"):
            if os.path.exists(f"{self.path}{ending}"):
                os.replace(f"{self.path}{ending}", f"{aside}{ending}")
        log.error("journal %s cannot be used (%s): moved it to %s and created a new one", self.path, cause, aside)
        return self._open()

    def _open(self) -> sqlite3.Connection:
        db = self.connect()
        try:
            is_new = not db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            found = [db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")]
            if not is_new and found != [_APPLICATION, _VERSION]:
                raise sqlite3.DatabaseError("file is not a journal of this version")
            db.execute(f"PRAGMA page_size={_PAGE_SIZE}")
            db.execute("PRAGMA journal_mode=WAL")
            db.execute(self._synchronous)
            db.execute("PRAGMA wal_autocheckpoint=0")  # retention checkpoints, so that no request waits for the disk
            db.execute(f"PRAGMA journal_size_limit={LOG_LIMIT}")
            if is_new:
                marks = f"PRAGMA application_id={_APPLICATION}; PRAGMA user_version={_VERSION};"
                db.executescript(f"BEGIN; {_SCHEMA} {marks} COMMIT")
            db.executescript(_MORE_INDEXES)
        except sqlite3.Error:
            db.close()
            raise
        return db


def read_only(path: Path) -> sqlite3.Connection:
    """Opens a read-only connection. Each transaction sees one state and never blocks the writer."""
    address = f"{path.absolute().as_uri()}?mode=ro"
    return sqlite3.connect(address, uri=True, isolation_level=None, check_same_thread=False)


def read_meta(db: sqlite3.Connection, key: str) -> Any:
    """The value of a key of the table `meta`; None when there is none."""
    found = db.execute("SELECT value FROM meta WHERE key=?", (key,)).fetchone()
    return found[0] if found is not None else None


def write_meta(db: sqlite3.Connection, **values: str) -> None:
    """Writes values of the table `meta`."""
    db.executemany("INSERT OR REPLACE INTO meta VALUES (?,?)", values.items())


# -- retention ------------------------------------------------------------------------------------------------------

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

    A clock that is set while the process runs makes no state older or younger: the age of what this process has written
    is its own running time, and that of earlier states counts from the clock at the start.

    :param days: the retention period (days); 0: unlimited.
    :param max_bytes: the maximum size of the content.
    :param merge: writes what waits to the tables.
    :param clock, monotonic: the time since the epoch, and a clock that nobody sets (s).
    """

    def __init__(
        self,
        file: JournalFile,
        days: float,
        max_bytes: int,
        merge: Callable[[], None],
        clock: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._file = file
        self._monotonic = monotonic
        self._offset = clock() - monotonic()
        self._written: list[tuple[float, int]] = []  # when the newest request had which number (s, monotonic)
        self._days = days
        self._max_bytes = max_bytes
        self._merge = merge
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
                except (Refused, sqlite3.Error, OSError) as error:
                    log.error("journal %s: retention failed: %s", self._file.path, error)

    def prune(self) -> None:
        """Checkpoints the write-ahead log, prunes expired states, then the oldest ones until the size fits."""
        self._merge()
        with closing(self._file.connect()) as db:
            db.execute("PRAGMA wal_checkpoint(PASSIVE)")
            if os.path.getsize(f"{self._file.path}-wal") > LOG_LIMIT:
                with self._file.writing:  # under load, a passive checkpoint never completes
                    db.execute("PRAGMA wal_checkpoint(RESTART)")
            if self._days:
                self._prune_before(db, max(int(read_meta(db, "begin") or 0), self._newest_expired(db)))
            while not self._stopped.is_set() and _size(db) > self._max_bytes:
                count = db.execute("SELECT count(*) FROM request").fetchone()[0]
                if count < 2:
                    return  # only the current state is left
                part = (max(count // _PART, 1),)
                begin = db.execute("SELECT number FROM request ORDER BY number LIMIT 1 OFFSET ?", part).fetchone()
                self._prune_before(db, begin[0])

    @property
    def _expiry(self) -> float:
        """The time before which states have expired (s, monotonic)."""
        return self._monotonic() - self._days * 86400.0

    def _newest_expired(self, db: sqlite3.Connection) -> int:
        """The number of the newest expired request."""
        now = self._monotonic()
        if not self._written or now - self._written[-1][0] > self._days * 864.0:
            newest = db.execute("SELECT max(number) FROM request").fetchone()[0]
            self._written.append((now, newest or 0))
        while len(self._written) > 1 and self._written[1][0] < self._expiry:
            del self._written[0]
        expired_at, newest = self._written[0]
        if expired_at < self._expiry:
            return newest
        return min(newest, _request_at(db, self._expiry + self._offset))

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
