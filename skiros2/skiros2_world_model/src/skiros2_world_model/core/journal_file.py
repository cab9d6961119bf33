"""The file of the journal: an SQLite database with one writing server and any number of readers.

Each table holds the current state. Its counterpart `past_...` holds rows that were valid from the request `since`
(inclusive) to the request `until` (exclusive), so that one query returns a past state or the changes of a request.
"""

from __future__ import annotations

import fcntl
import logging
import os
import sqlite3
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from skiros2_common.core.errors import ConfigurationError, Refused

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
_APPLICATION = 0x534B5232  # "SKR2"
_VERSION = 1

#: Smaller than SQLite's default (bytes), because a request changes few rows on many pages and writes whole pages.
_PAGE_SIZE = 2048
#: The size to which the write-ahead log is truncated after a checkpoint (bytes).
LOG_LIMIT = 1 << 26
#: How long a server waits for a previous server to exit (s).
_LOCK_TIMEOUT = 5.0


class JournalFile:
    """The database, opened for writing. Hold `writing` while using the connection `writer`.

    A killed process loses no committed transaction. With `full_sync`, a power failure loses none either.

    :param path: created, with its folder, when it does not exist. A damaged or foreign file is moved aside.
    :param full_sync: syncs every commit to disk.
    :raises ConfigurationError: another server uses the journal, or it cannot be created.
    """

    def __init__(self, path: Path, full_sync: bool = False) -> None:
        self.path = path
        self.writing = threading.Lock()
        self._full_sync = full_sync
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = _lock(path)
        except OSError as error:
            raise ConfigurationError(f"journal {path}: {error.strerror or error}") from None
        try:
            self.writer = self._open()
        except sqlite3.OperationalError as error:
            self._lock.close()
            raise ConfigurationError(f"journal {path}: {error}") from None
        except sqlite3.DatabaseError as error:
            self.writer = self._move_aside(error)

    def check(self) -> None:
        """Checks the integrity of the whole file.

        :raises sqlite3.DatabaseError: the file is damaged.
        """
        found = self.writer.execute("PRAGMA quick_check(1)").fetchone()[0]
        if found != "ok":
            raise sqlite3.DatabaseError(found)

    def start_over(self, cause: Exception) -> None:
        """Moves the file aside and creates an empty one."""
        self.writer.close()
        self.writer = self._move_aside(cause)

    def connect(self) -> sqlite3.Connection:
        """Opens another connection."""
        return sqlite3.connect(self.path, isolation_level=None, check_same_thread=False)

    def close(self) -> None:
        """Closes the file and releases the lock on it."""
        self.writer.close()
        self._lock.close()

    def _move_aside(self, cause: Exception) -> sqlite3.Connection:
        aside = f"{self.path}.damaged-{time.strftime('%Y%m%d-%H%M%S')}"
        for ending in ("", "-wal", "-shm"):
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
            db.execute(f"PRAGMA synchronous={'FULL' if self._full_sync else 'NORMAL'}")
            db.execute("PRAGMA wal_autocheckpoint=0")  # retention checkpoints, so that no request waits for the disk
            db.execute(f"PRAGMA journal_size_limit={LOG_LIMIT}")
            if is_new:
                record_lookup = f"PRAGMA application_id={_APPLICATION}; PRAGMA user_version={_VERSION};"
                db.executescript(f"BEGIN; {_SCHEMA} {record_lookup} COMMIT")
        except sqlite3.Error:
            db.close()
            raise
        return db


class JournalTransaction:
    """A transaction as a context manager: commits the writes on `db` at its end, or rolls them back on an exception.

    :raises Refused: the journal cannot be written.
    """

    def __init__(self, file: JournalFile) -> None:
        self._file = file
        self.db = file.writer

    def __enter__(self) -> Self:
        self._file.writing.acquire()
        try:
            self.db = self._file.writer
            self.db.execute("BEGIN IMMEDIATE")
        except sqlite3.Error as error:
            self._file.writing.release()
            raise self._refusal(error) from error
        return self

    def __exit__(self, kind: type | None, error: Exception | None, trace: TracebackType | None) -> None:
        try:
            if error is None:
                self._finish()
        except sqlite3.Error as failure:
            error = failure
        finally:
            try:
                if error is not None and self.db.in_transaction:
                    self.db.execute("ROLLBACK")
            finally:
                self._file.writing.release()
        if isinstance(error, (sqlite3.Error, UnicodeError)):
            raise self._refusal(error) from error

    def _finish(self) -> None:
        self.db.execute("COMMIT")

    def _refusal(self, error: Exception) -> Refused:
        return Refused(f"journal {self._file.path} cannot be written: {error}; the request is refused")


def read_only(path: Path) -> sqlite3.Connection:
    """Opens a read-only connection. Each transaction sees one state and never blocks the writer."""
    address = f"{path.absolute().as_uri()}?mode=ro"
    return sqlite3.connect(address, uri=True, isolation_level=None, check_same_thread=False)


def read_meta(db: sqlite3.Connection, key: str) -> Any:
    """The value of a key of the table `meta`; None when there is none."""
    found = db.execute("SELECT value FROM meta WHERE key=?", (key,)).fetchone()
    return found[0] if found is not None else None


def _lock(path: Path) -> IO[bytes]:
    """Locks a file beside the journal for the lifetime of the process; SQLite's locks only separate transactions."""
    lock = open(f"{path}.lock", "wb")  # noqa: SIM115 - stays open
    deadline = time.monotonic() + _LOCK_TIMEOUT
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            if time.monotonic() > deadline:
                lock.close()
                raise ConfigurationError(f"journal {path}: another world model is using it") from None
            time.sleep(0.05)
