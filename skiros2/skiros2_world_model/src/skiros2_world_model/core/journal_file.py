"""The journal's file: an SQLite database that one server at a time writes, and anybody may read.

Each table holds what is so now, its twin `past_...` what was so, from the request `since` (inclusive) to the request
`until` (exclusive). So the state at a number is one question, and so is what a request changed.
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
-- number: of the first change that the request made; last: of the last one; past: the last row of past_element then
CREATE TABLE request (number INTEGER PRIMARY KEY, last INTEGER, stamp REAL, author TEXT, action TEXT, context TEXT,
    past INTEGER);
-- next_number: for ids; all from it on are free
CREATE TABLE context (name TEXT PRIMARY KEY, file TEXT, next_number INTEGER);
-- made, stamp, author: the last change of the element or of a relation of it
CREATE TABLE element (context TEXT, id TEXT, since INTEGER, made INTEGER, stamp REAL, author TEXT, content TEXT);
CREATE UNIQUE INDEX element_id ON element (context, id);
-- its rows are in the order of until, which `request.past` tells
CREATE TABLE past_element (until INTEGER, context TEXT, id TEXT, since INTEGER, content TEXT);
CREATE INDEX past_element_id ON past_element (context, id);
CREATE TABLE relation (context TEXT, src TEXT, pred TEXT, dst TEXT, since INTEGER);
CREATE UNIQUE INDEX relation_ends ON relation (context, src, pred, dst);
CREATE TABLE past_relation (until INTEGER, context TEXT, src TEXT, pred TEXT, dst TEXT, since INTEGER);
CREATE INDEX past_relation_until ON past_relation (until);
-- statements beside elements, as N-Triples; those of the ontologies as differences from their files: present 0 is one
-- that was taken away
CREATE TABLE statement (context TEXT, triple TEXT, present INTEGER, since INTEGER);
CREATE UNIQUE INDEX statement_triple ON statement (context, triple);
CREATE TABLE past_statement (until INTEGER, context TEXT, triple TEXT, present INTEGER, since INTEGER);
CREATE INDEX past_statement_until ON past_statement (until);
"""
_APPLICATION = 0x534B5232  # "SKR2", in the head of the file
_VERSION = 1

#: Smaller than SQLite's usual: a request touches few rows on many pages, and writes the pages whole.
_PAGE_SIZE = 2048
#: What the write-ahead log keeps of the disk when it begins anew (bytes).
LOG_LIMIT = 1 << 26
#: How long a server waits for one before it that is about to end (s).
_PATIENCE = 5.0


class JournalFile:
    """The database, opened for writing: its connection `writer`, to be used while `writing` is held.

    Transactions are in the file when they are committed: a process that is killed loses none. With `full_sync` they are
    on the disk by then, so that a power cut loses none either.

    :param path: made when it is not there, with its folder. What is there and is no journal, or a damaged one, is moved
        aside.
    :raises ConfigurationError: another server uses it, or it cannot be made.
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
            self.writer = self._begin_anew(error)

    def check(self) -> None:
        """Reads all of it.

        :raises sqlite3.DatabaseError: it is damaged.
        """
        found = self.writer.execute("PRAGMA quick_check(1)").fetchone()[0]
        if found != "ok":
            raise sqlite3.DatabaseError(found)

    def begin_anew(self, cause: Exception) -> None:
        """Moves the file aside, and begins an empty one."""
        self.writer.close()
        self.writer = self._begin_anew(cause)

    def connect(self) -> sqlite3.Connection:
        """A further connection."""
        return sqlite3.connect(self.path, isolation_level=None, check_same_thread=False)

    def close(self) -> None:
        """Closes the file; others may use it."""
        self.writer.close()
        self._lock.close()

    def _begin_anew(self, cause: Exception) -> sqlite3.Connection:
        aside = f"{self.path}.damaged-{time.strftime('%Y%m%d-%H%M%S')}"
        for ending in ("", "-wal", "-shm"):
            if os.path.exists(f"{self.path}{ending}"):
                os.replace(f"{self.path}{ending}", f"{aside}{ending}")
        log.error("journal %s cannot be used (%s): it is now %s, and a new one begins", self.path, cause, aside)
        return self._open()

    def _open(self) -> sqlite3.Connection:
        db = self.connect()
        try:
            is_new = not db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
            found = [db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")]
            if not is_new and found != [_APPLICATION, _VERSION]:
                raise sqlite3.DatabaseError("file is no journal of this version")
            db.execute(f"PRAGMA page_size={_PAGE_SIZE}")
            db.execute("PRAGMA journal_mode=WAL")
            db.execute(f"PRAGMA synchronous={'FULL' if self._full_sync else 'NORMAL'}")
            db.execute("PRAGMA wal_autocheckpoint=0")  # housekeeping does it, so that no request waits for the disk
            db.execute(f"PRAGMA journal_size_limit={LOG_LIMIT}")
            if is_new:
                marks = f"PRAGMA application_id={_APPLICATION}; PRAGMA user_version={_VERSION};"
                db.executescript(f"BEGIN; {_SCHEMA} {marks} COMMIT")
        except sqlite3.Error:
            db.close()
            raise
        return db


class JournalTransaction:
    """Writes that are in the journal when the `with` block ends, or none of them; `db` is to be used within.

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
    """A connection that sees one state of the journal in each transaction, and never holds up the writer."""
    address = f"{path.absolute().as_uri()}?mode=ro"
    return sqlite3.connect(address, uri=True, isolation_level=None, check_same_thread=False)


def read_note(db: sqlite3.Connection, key: str) -> Any:
    """What a journal notes of itself; None when nothing."""
    found = db.execute("SELECT value FROM meta WHERE key=?", (key,)).fetchone()
    return found[0] if found is not None else None


def _lock(path: Path) -> IO[bytes]:
    """A file beside it, locked while this process lives: SQLite's own locks part transactions, not servers."""
    lock = open(f"{path}.lock", "wb")  # noqa: SIM115 - stays open
    give_up = time.monotonic() + _PATIENCE
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            if time.monotonic() > give_up:
                lock.close()
                raise ConfigurationError(f"journal {path}: another world model is using it") from None
            time.sleep(0.05)
