"""The journal of a world model: every change with its time and author, on disk before anybody is told of it.

A world model that was killed goes on from it: with the same elements under the same ids, the same session and the
numbers after the last one. What is so no more stays in the journal for its history (`core/history.py`) until it is too
old or there is too much of it.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_world_model.core.housekeeping import Housekeeping
from skiros2_world_model.core.journal_file import JournalFile, JournalTransaction, read_note
from skiros2_world_model.core.journal_state import JournalState, read_state
from skiros2_world_model.core.journal_writer import JournalWriter
from skiros2_world_model.core.scene import Provenance, Scene

#: When a world model goes on from its journal: after it was killed, whenever there is one, or not at all.
KILLED, ALWAYS, NEVER = "killed", "always", "never"

#: A context: its name, its scene, what is beside elements as N-Triples, its file.
Content = tuple[str, Scene, Iterable[str], str]

_RUNNING, _ENDED = "running", "ended"

#: What the keys of notes of others begin with.
_KEPT = "kept "


class Journal:
    """The journal that a world model writes. Used under the world model's lock; housekeeping has a thread of its own.

    :param path: the file.
    :param origin: what the world model starts from otherwise; it does not go on from a journal of another origin.
    :param recover: when it goes on: `KILLED`, `ALWAYS` or `NEVER`.
    :param days: for how long the past is kept; 0: for as long as there is room.
    :param max_bytes: how large it may grow before the oldest of the past is dropped. The present is kept in any case.
    :param full_sync: waits at each request until the disk has it, so that a power cut loses nothing either.
    :raises ConfigurationError: another world model is using it, or it cannot be made.
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
            choice = f"{KILLED}, {ALWAYS} or {NEVER}"
            raise ConfigurationError(f"journal {path}: journal_recover is {recover!r}, expected {choice}")
        self.path = path
        #: The number of the last change; known once `restore` was called.
        self.last = 0
        self._origin = origin
        self._recover = recover
        self._file = JournalFile(path, full_sync)
        self._next_numbers: dict[str, int] = {}
        self._housekeeping = Housekeeping(self._file, days, max_bytes)

    # -- one life after the other ------------------------------------------------------------------------------

    def restore(self) -> JournalState | None:
        """What the world model goes on from; None when it is to `start`. Called first."""
        state = None
        db = self._file.writer
        try:
            found = db.execute("SELECT last FROM request ORDER BY number DESC LIMIT 1").fetchone()
            self.last = found[0] if found is not None else 0
            if self._goes_on(db):
                self._file.check()
                state = read_state(db)
        except (sqlite3.DatabaseError, LookupError, SyntaxError, TypeError, ValueError) as error:
            self._file.begin_anew(error)
        if state is not None:
            self._housekeeping.start()
        return state

    def start(self, session: str, made: Provenance, contents: Sequence[Content]) -> None:
        """A world model that does not go on begins with these contexts and no others.

        :param made: the change that this is.
        :param contents: as `JournalWriter.whole` takes them.
        :param session: of its snapshot ids.
        :raises Refused: the journal cannot be written.
        """
        try:
            self._start(session, made, contents)
        except Refused as error:
            cause = error.__cause__
            if not isinstance(cause, sqlite3.DatabaseError) or isinstance(cause, sqlite3.OperationalError):
                raise
            self._file.begin_anew(cause)
            self._start(session, made, contents)
        self._housekeeping.start()

    def close(self, clean: bool = True) -> None:
        """The world model has ended: what it asks for from now on is refused.

        :param clean: in good order: the next life starts from its files.
        :raises Refused: the journal cannot be written.
        """
        self._housekeeping.stop()
        try:
            if clean:
                with JournalTransaction(self._file) as transaction:
                    _note(transaction.db, state=_ENDED)
        finally:
            self._file.close()

    # -- writing -----------------------------------------------------------------------------------------------

    def request(self, made: Provenance, last: int, action: str, context: str) -> JournalWriter:
        """One request, to be entered: what is written within is in the journal when it is left, or nothing of it.

        :param made: its first change.
        :param last: the number of its last change.
        :param action: as `HistoryEntry` tells it.
        """
        self._housekeeping.count_request()
        return JournalWriter(self._file, made, last, action, context, self._next_numbers)

    def write_file(self, context: str, file: str) -> None:
        """A context has another file.

        :raises Refused: the journal cannot be written.
        """
        with JournalTransaction(self._file) as transaction:
            transaction.db.execute("UPDATE context SET file=? WHERE name=?", (file, context))

    # -- notes -------------------------------------------------------------------------------------------------

    def keep(self, key: str, text: str) -> None:
        """Notes something beside the contexts. It is gone when a world model does not go on from the journal.

        :raises Refused: the journal cannot be written.
        """
        with JournalTransaction(self._file) as transaction:
            transaction.db.execute("INSERT OR REPLACE INTO meta VALUES (?,?)", (_KEPT + key, text))

    def kept(self, key: str) -> str:
        """What was noted; "" when nothing was."""
        return str(read_note(self._file.writer, _KEPT + key) or "")

    def _start(self, session: str, made: Provenance, contents: Sequence[Content]) -> None:
        with self.request(made, made.version, "start", "") as writer:
            writer.clear()
            writer.db.execute("DELETE FROM meta WHERE key LIKE ?", (f"{_KEPT}%",))
            for content in contents:
                writer.whole(*content)
            _note(writer.db, session=session, state=_RUNNING, origin=self._origin)
            writer.db.execute("INSERT OR IGNORE INTO meta VALUES ('begin', ?)", (made.version,))

    def _goes_on(self, db: sqlite3.Connection) -> bool:
        state = read_note(db, "state")
        if self._recover == ALWAYS:
            return state is not None
        return self._recover == KILLED and state == _RUNNING and read_note(db, "origin") == self._origin


def first_number() -> int:
    """The number that a world model without a past counts from: higher than all of its earlier lives.

    It is the time, in microseconds since the epoch: no world model makes a million changes in a second.
    """
    return int(time.time() * 1e6)


def _note(db: sqlite3.Connection, **notes: str) -> None:
    db.executemany("INSERT OR REPLACE INTO meta VALUES (?,?)", notes.items())
