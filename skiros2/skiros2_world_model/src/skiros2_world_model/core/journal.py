"""The journal of a world model: every change with its time and author, on disk before it is published.

A killed world model recovers from it with the same elements and ids, the same session, and continuing change numbers.
Past states stay in the journal for queries of the history (`core/history.py`) until the retention limits are reached.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_world_model.core.journal_file import JournalFile, JournalTransaction, read_meta
from skiros2_world_model.core.journal_state import JournalState, read_state
from skiros2_world_model.core.journal_writer import JournalWriter
from skiros2_world_model.core.retention import Retention
from skiros2_world_model.core.scene import Provenance, Scene

#: When a world model recovers from its journal: after it was killed, always, or never.
KILLED, ALWAYS, NEVER = "killed", "always", "never"

#: A context: its name, its scene, its extra triples as N-Triples, its file.
Content = tuple[str, Scene, Iterable[str], str]

_RUNNING, _ENDED = "running", "ended"

#: The prefix of the meta keys of `Journal.set_meta`.
_META_PREFIX = "kept "


class Journal:
    """The journal of one world model. Used under the world model's lock; retention runs in its own thread.

    :param path: the file.
    :param origin: identifies the initial files; with `KILLED`, a journal of another origin is not recovered.
    :param recover: when the world model recovers: `KILLED`, `ALWAYS` or `NEVER`.
    :param days: the retention period of past states (days); 0: unlimited.
    :param max_bytes: the maximum size; the oldest past states are pruned when it is exceeded. The current state stays.
    :param full_sync: syncs to disk in every request, so that a power failure loses no change.
    :raises ConfigurationError: another world model uses the journal, or it cannot be created.
    """

    def __init__(
        self,
        path: Path,
        origin: str = "",
        recover: str = KILLED,
        days: float = 30.0,
        max_bytes: int = 1 << 30,
        full_sync: bool = False,
    ) -> None:
        if recover not in (KILLED, ALWAYS, NEVER):
            options = f"{KILLED}, {ALWAYS} or {NEVER}"
            raise ConfigurationError(f"journal {path}: journal_recover is {recover!r}, expected {options}")
        self.path = path
        #: The number of the last change; valid after `restore`.
        self.last = 0
        self._origin = origin
        self._recover = recover
        self._file = JournalFile(path, full_sync)
        self._next_numbers: dict[str, int] = {}
        self._retention = Retention(self._file, days, max_bytes)

    # -- start and end -----------------------------------------------------------------------------------------

    def restore(self) -> JournalState | None:
        """Returns the state to recover, or None when the world model must `start`. Call it first."""
        state = None
        db = self._file.writer
        try:
            found = db.execute("SELECT last FROM request ORDER BY number DESC LIMIT 1").fetchone()
            self.last = found[0] if found is not None else 0
            if self._should_recover(db):
                self._file.check()
                state = read_state(db)
        except (sqlite3.DatabaseError, LookupError, SyntaxError, TypeError, ValueError) as error:
            self._file.start_over(error)
        if state is not None:
            self._retention.start()
        return state

    def start(self, session: str, provenance: Provenance, contents: Sequence[Content]) -> None:
        """Replaces the current state with the initial contexts of a world model that does not recover.

        :param session: the session of its snapshot ids.
        :param provenance: the provenance of the start.
        :param contents: as for `JournalWriter.replace_context`.
        :raises Refused: the journal cannot be written.
        """
        try:
            self._start(session, provenance, contents)
        except Refused as error:
            cause = error.__cause__
            if not isinstance(cause, sqlite3.DatabaseError) or isinstance(cause, sqlite3.OperationalError):
                raise
            self._file.start_over(cause)
            self._start(session, provenance, contents)
        self._retention.start()

    def close(self, clean: bool = True) -> None:
        """Closes the journal; later requests are refused.

        :param clean: marks a regular shutdown, after which `KILLED` does not recover.
        :raises Refused: the journal cannot be written.
        """
        self._retention.stop()
        try:
            if clean:
                with JournalTransaction(self._file) as transaction:
                    _set_meta(transaction.db, state=_ENDED)
        finally:
            self._file.close()

    # -- writing -----------------------------------------------------------------------------------------------

    def request(self, provenance: Provenance, last: int, action: str, context: str) -> JournalWriter:
        """Opens a transaction for one request, as a context manager.

        :param provenance: the provenance of its first change.
        :param last: the number of its last change.
        :param action: see `HistoryEntry`.
        """
        self._retention.count_request()
        return JournalWriter(self._file, provenance, last, action, context, self._next_numbers)

    def write_file(self, context: str, file: str) -> None:
        """Records the file of a context.

        :raises Refused: the journal cannot be written.
        """
        with JournalTransaction(self._file) as transaction:
            transaction.db.execute("UPDATE context SET file=? WHERE name=?", (file, context))

    # -- meta data ---------------------------------------------------------------------------------------------

    def set_meta(self, key: str, text: str) -> None:
        """Stores a text under a key. `start` deletes it.

        :raises Refused: the journal cannot be written.
        """
        with JournalTransaction(self._file) as transaction:
            transaction.db.execute("INSERT OR REPLACE INTO meta VALUES (?,?)", (_META_PREFIX + key, text))

    def get_meta(self, key: str) -> str:
        """The text stored under a key; "" when there is none."""
        return str(read_meta(self._file.writer, _META_PREFIX + key) or "")

    def _start(self, session: str, provenance: Provenance, contents: Sequence[Content]) -> None:
        with self.request(provenance, provenance.version, "start", "") as writer:
            writer.clear()
            writer.db.execute("DELETE FROM meta WHERE key LIKE ?", (f"{_META_PREFIX}%",))
            for content in contents:
                writer.replace_context(*content)
            _set_meta(writer.db, session=session, state=_RUNNING, origin=self._origin)
            writer.db.execute("INSERT OR IGNORE INTO meta VALUES ('begin', ?)", (provenance.version,))

    def _should_recover(self, db: sqlite3.Connection) -> bool:
        state = read_meta(db, "state")
        if self._recover == ALWAYS:
            return state is not None
        return self._recover == KILLED and state == _RUNNING and read_meta(db, "origin") == self._origin


def first_number() -> int:
    """The start number of a world model without a journal: the time in microseconds since the epoch.

    It is higher than all numbers of earlier processes, as no world model makes a million changes per second.
    """
    return int(time.time() * 1e6)


def _set_meta(db: sqlite3.Connection, **notes: str) -> None:
    db.executemany("INSERT OR REPLACE INTO meta VALUES (?,?)", notes.items())
