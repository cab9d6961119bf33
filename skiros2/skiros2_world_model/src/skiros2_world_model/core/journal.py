"""The journal of a world model: every change with its time and author, on disk before it is published.

A killed world model recovers from it with the same elements and ids, the same session, and continuing change numbers.
Past states stay in the journal for queries of the history (`core/history.py`) until the retention limits are reached.

Changes of scenes are written to a log first (`core/request_log.py`), everything else to the tables directly.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from skiros2_common.core.changeset import ChangeInfo, ElementRecord, read_record, record_json
from skiros2_common.core.collector import collector_paused
from skiros2_common.core.errors import ConfigurationError, Refused
from skiros2_common.core.operations import ONTOLOGY
from skiros2_world_model.core.journal_file import JournalFile, Retention, read_meta, read_only, write_meta
from skiros2_world_model.core.request_log import LogLine, RequestLog, RequestPart
from skiros2_world_model.core.scene import Scene

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
    :param full_sync: syncs each `write` to disk, so that a power failure loses no change.
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
        self._log = RequestLog(self._file, _merge)
        self._retention = Retention(self._file, days, max_bytes, self.flush)

    @property
    def full_sync(self) -> bool:
        """Whether each request is synced to disk. It may be set at any time, by any thread."""
        return self._file.full_sync

    @full_sync.setter
    def full_sync(self, wanted: bool) -> None:
        self._file.set_full_sync(wanted)

    # -- start and end -----------------------------------------------------------------------------------------

    def restore(self) -> JournalState | None:
        """Returns the state to recover, or None when the world model must `start`. Call it first.

        :raises Refused: the journal cannot be written.
        """
        state = None
        db = self._file.writer
        try:
            if wanted := self._should_recover(db):
                self._file.check()
            self._log.recover()
            found = db.execute("SELECT last FROM request ORDER BY number DESC LIMIT 1").fetchone()
            self.last = found[0] if found is not None else 0
            state = read_state(db) if wanted else None
            if wanted and not _was_running(db, self._origin):
                with self._file.transaction():
                    write_meta(db, state=_RUNNING, origin=self._origin)
        except (Refused, sqlite3.DatabaseError, LookupError, SyntaxError, TypeError, ValueError) as error:
            if isinstance(error.__cause__, sqlite3.OperationalError):
                raise  # such as a full disk, on which the log cannot be merged
            self._start_over(error)
        if state is not None:
            self._retention.start()
        return state

    def start(self, session: str, change_info: ChangeInfo, contents: Sequence[Content]) -> None:
        """Replaces the current state with the initial contexts of a world model that does not recover.

        :param session: the session of its snapshot ids.
        :param change_info: the start, as a change.
        :param contents: as for `JournalWriter.replace_context`.
        :raises Refused: the journal cannot be written.
        """
        try:
            self._start(session, change_info, contents)
        except Refused as error:
            cause = error.__cause__
            if not isinstance(cause, sqlite3.DatabaseError) or isinstance(cause, sqlite3.OperationalError):
                raise
            self._start_over(cause)
            self._start(session, change_info, contents)
        self._retention.start()

    def close(self, clean: bool = True) -> None:
        """Closes the journal; later requests are refused.

        :param clean: marks a regular shutdown, after which `KILLED` does not recover.
        :raises Refused: the journal cannot be written.
        """
        self._retention.stop()
        try:
            if clean:
                self._log.merge()
                with self._file.transaction() as db:
                    write_meta(db, state=_ENDED)
        finally:
            self._log.close()
            self._file.close()

    # -- writing -----------------------------------------------------------------------------------------------

    def write(self, lines: Sequence[LogLine]) -> None:
        """Writes requests to the log, all or none, with one sync.

        :raises Refused: the journal cannot be written.
        """
        for _ in lines:
            self._retention.count_request()
        self._log.append(lines)

    def flush(self) -> None:
        """Waits until the tables have all requests so far. Any thread.

        :raises Refused: the journal cannot be written.
        """
        self._log.merge()

    @contextmanager
    def request(self, change_info: ChangeInfo, last: int, action: str, context: str) -> Iterator[JournalWriter]:
        """A transaction that writes one request to the tables.

        :param change_info: its first change.
        :param last: the number of its last change.
        :param action: see `HistoryEntry`.
        :raises Refused: the journal cannot be written.
        """
        self._retention.count_request()
        self._log.merge()
        with self._file.transaction() as db:
            yield JournalWriter(db, change_info)
            db.execute(_REQUEST, (change_info.version, last, change_info.stamp, change_info.author, action, context))
        self._log.note(change_info.version)

    def write_file(self, context: str, file: str) -> None:
        """Records the file of a context.

        :raises Refused: the journal cannot be written.
        """
        self._log.merge()  # the context may be new
        with self._file.transaction() as db:
            db.execute("UPDATE context SET file=? WHERE name=?", (file, context))

    # -- meta data ---------------------------------------------------------------------------------------------

    def set_meta(self, key: str, text: str) -> None:
        """Stores a text under a key. `start` deletes it.

        :raises Refused: the journal cannot be written.
        """
        with self._file.transaction() as db:
            write_meta(db, **{_META_PREFIX + key: text})

    def get_meta(self, key: str) -> str:
        """The text stored under a key; "" when there is none."""
        return str(read_meta(self._file.writer, _META_PREFIX + key) or "")

    def _start_over(self, cause: Exception) -> None:
        self._log.close()
        self._file.start_over(cause)
        self._log = RequestLog(self._file, _merge)
        self._log.recover()

    def _start(self, session: str, change_info: ChangeInfo, contents: Sequence[Content]) -> None:
        with self.request(change_info, change_info.version, "start", "") as writer:
            writer.clear()
            writer.db.execute("DELETE FROM meta WHERE key LIKE ?", (f"{_META_PREFIX}%",))
            for content in contents:
                writer.replace_context(*content)
            write_meta(writer.db, session=session, state=_RUNNING, origin=self._origin)
            writer.db.execute("INSERT OR IGNORE INTO meta VALUES ('begin', ?)", (change_info.version,))

    def _should_recover(self, db: sqlite3.Connection) -> bool:
        if self._recover == ALWAYS:
            return read_meta(db, "state") is not None
        return self._recover == KILLED and _was_running(db, self._origin)


def first_number() -> int:
    """The start number of a world model without a journal: the time in microseconds since the epoch. It is higher than
    all numbers of earlier processes, as no world model makes a million changes per second."""
    return int(time.time() * 1e6)


def _was_running(db: sqlite3.Connection, origin: str) -> bool:
    return bool(read_meta(db, "state") == _RUNNING and read_meta(db, "origin") == origin)


# -- the recorded state --------------------------------------------------------------------------------------------


@dataclass
class ContextState:
    """The state of a context in the journal.

    :param file: the file it was last loaded from or saved to; "": none.
    :param next_number: the lowest unused id number.
    :param extras: its extra triples, as N-Triples.
    """

    name: str
    file: str
    next_number: int
    records: list[ElementRecord] = field(default_factory=list)
    relations: list[tuple[str, str, str]] = field(default_factory=list)
    extras: list[str] = field(default_factory=list)


@dataclass
class JournalState:
    """The state of a world model in the journal.

    :param session: the session of its snapshot ids.
    :param number: the number of the last change.
    :param last: the last change.
    :param stated: the triples added to the ontologies since they were read from files, as N-Triples.
    :param unstated: the triples removed from the ontologies since they were read from files.
    """

    session: str
    number: int
    last: ChangeInfo
    contexts: list[ContextState]
    stated: list[str]
    unstated: list[str]

    def __str__(self) -> str:
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.last.stamp))
        size = ", ".join(f"{len(context.records)} elements in {context.name}" for context in self.contexts)
        return f"{size}; last change by {self.last.author}, {when}"


@collector_paused()
def read_state(db: sqlite3.Connection) -> JournalState:
    """Reads the current state. Elements and relations are in the order of their creation.

    :raises sqlite3.DatabaseError, ValueError, LookupError, TypeError: the journal is damaged.
    """
    session = read_meta(db, "session")
    contexts = {name: ContextState(name, *more) for name, *more in db.execute("SELECT * FROM context ORDER BY rowid")}
    change_info: dict[tuple[int, float, str], ChangeInfo] = {}
    rows = db.execute("SELECT context, id, content, made, stamp, author FROM element ORDER BY rowid")
    for context, eid, content, *change in rows:
        key = (change[0], change[1], change[2])
        known = change_info.get(key) or change_info.setdefault(key, ChangeInfo(*key))
        contexts[context].records.append(read_record(eid, content, known))
    for context, *relation in db.execute("SELECT context, src, pred, dst FROM relation ORDER BY rowid"):
        contexts[context].relations.append((relation[0], relation[1], relation[2]))
    stated: dict[bool, list[str]] = {True: [], False: []}
    for context, triple, present in db.execute("SELECT context, triple, present FROM statement ORDER BY rowid"):
        (stated[bool(present)] if context == ONTOLOGY else contexts[context].extras).append(triple)
    request = "SELECT last, number, stamp, author FROM request ORDER BY number DESC LIMIT 1"
    number, *last = db.execute(request).fetchone()
    return JournalState(str(session), number, ChangeInfo(*last), list(contexts.values()), stated[True], stated[False])


def recorded_state(path: Path) -> JournalState:
    """Reads the present state of a journal, which another process may be writing.

    :raises ConfigurationError: the journal cannot be read.
    """
    include_log(path)
    try:
        with closing(read_only(path)) as db:
            db.execute("BEGIN")
            return read_state(db)
    except (sqlite3.DatabaseError, LookupError, SyntaxError, TypeError, ValueError) as error:
        raise ConfigurationError(f"journal {path} cannot be read: {error}") from None


def include_log(path: Path) -> None:
    """Merges what a killed world model has left in the log of its journal; one that runs does so itself."""
    log = Path(f"{path}-log")
    if log.is_file() and log.stat().st_size:
        with (
            suppress(ConfigurationError),
            closing(JournalFile(path, timeout=0.0)) as file,
            closing(RequestLog(file, _merge)) as requests,
        ):
            requests.recover()


def is_recoverable(path: Path, origin: str) -> bool:
    """Whether a journal of an origin has a state to recover. Any process may write it meanwhile."""
    try:
        with closing(read_only(path)) as db:
            return _was_running(db, origin)
    except sqlite3.DatabaseError:  # there is none, or it is damaged: it is created again
        return False


# -- the rows of a request -----------------------------------------------------------------------------------------

#: The versioned tables, and the columns that they share with their `past_` tables.
_TABLES = {
    "element": "context, id, since, content",
    "relation": "context, src, pred, dst, since",
    "statement": "context, triple, present, since",
}
#: Copies rows to the `past_` table.
_END = {
    table: f"INSERT INTO past_{table} (until, {columns}) SELECT ?, {columns} FROM {table} "
    for table, columns in _TABLES.items()
}
_REQUEST = "INSERT INTO request VALUES (?,?,?,?,?,?, (SELECT max(rowid) FROM past_element))"
_THE_ELEMENT = "WHERE context=? AND id=?"
_THE_RELATION = "WHERE context=? AND src=? AND pred=? AND dst=?"
_THE_STATEMENT = "WHERE context=? AND triple=?"

_END_ELEMENT = _END["element"] + _THE_ELEMENT
_CHANGE_ELEMENT = f"UPDATE element SET since=?, made=?, stamp=?, author=?, content=? {_THE_ELEMENT}"
_NEW_ELEMENT = "INSERT INTO element VALUES (?,?,?,?,?,?,?)"


class JournalWriter:
    """Writes the rows of one request.

    :param change_info: the first change of the request.
    """

    def __init__(self, db: sqlite3.Connection, change_info: ChangeInfo) -> None:
        self.db = db
        self._number = change_info.version
        self._columns = _columns(change_info)

    def clear(self, context: str = "") -> None:
        """Moves the content of a context to the past; with "" that of all contexts, and deletes the contexts."""
        where, names = ("WHERE context=?", (context,)) if context else ("", ())
        for table in _TABLES:
            self.db.execute(_END[table] + where, (self._number, *names))
            self.db.execute(f"DELETE FROM {table} {where}", names)
        if not context:
            self.db.execute("DELETE FROM context")

    def replace_context(self, context: str, scene: Scene, extras: Iterable[str], file: str) -> None:
        """Replaces the content of a context. The records keep their last change.

        :param extras: its extra triples, as N-Triples.
        """
        self.clear(context)
        self.context(context, scene.next_number)
        self.db.execute("UPDATE context SET file=? WHERE name=?", (file, context))
        number = self._number
        elements = ((context, r.id, number, *_columns(r.change_info), record_json(r)) for r in scene)
        self.db.executemany(_NEW_ELEMENT, elements)
        relations = ((context, *relation, number) for relation in scene.relations())
        self.db.executemany("INSERT INTO relation VALUES (?,?,?,?,?)", relations)
        statements = ((context, triple, number) for triple in extras)
        self.db.executemany("INSERT OR IGNORE INTO statement VALUES (?,?,1,?)", statements)

    def write(self, part: RequestPart) -> None:
        """Writes the changes of a scene."""
        for eid, content in part.elements:
            self._element(part.context, eid, content)
        for *relation, added in part.relations:
            self._relation((part.context, *relation), added)
        for eid in part.touched:
            row = (*self._columns, part.context, eid)
            self.db.execute(f"UPDATE element SET made=?, stamp=?, author=? {_THE_ELEMENT}", row)

    def ontology(self, removed: Iterable[str], added: Iterable[str]) -> None:
        """Writes removed and added triples of the ontologies, given as N-Triples."""
        number = self._number
        for triples, present in ((removed, 0), (added, 1)):
            for triple in triples:
                key = ONTOLOGY, triple
                self.db.execute(_END["statement"] + _THE_STATEMENT, (number, *key))
                self.db.execute(f"DELETE FROM statement {_THE_STATEMENT}", key)
                self.db.execute("INSERT INTO statement VALUES (?,?,?,?)", (*key, present, number))

    # -- rows --------------------------------------------------------------------------------------------------

    def context(self, name: str, number: int) -> None:
        """Writes the lowest unused id number of a context, which is created when it does not exist."""
        row = "INSERT INTO context VALUES (?, '', ?)"
        self.db.execute(f"{row} ON CONFLICT (name) DO UPDATE SET next_number=excluded.next_number", (name, number))

    def _element(self, context: str, eid: str, content: str | None) -> None:
        number, key = self._number, (context, eid)
        existed = self.db.execute(_END_ELEMENT, (number, *key)).rowcount
        if content is None:
            self.db.execute(f"DELETE FROM element {_THE_ELEMENT}", key)
        elif existed:
            self.db.execute(_CHANGE_ELEMENT, (number, *self._columns, content, *key))
        else:
            self.db.execute(_NEW_ELEMENT, (*key, number, *self._columns, content))

    def _relation(self, key: tuple[str, ...], exists: bool) -> None:
        number = self._number
        if exists:
            self.db.execute("INSERT OR IGNORE INTO relation VALUES (?,?,?,?,?)", (*key, number))
        elif self.db.execute(_END["relation"] + _THE_RELATION, (number, *key)).rowcount:
            self.db.execute(f"DELETE FROM relation {_THE_RELATION}", key)


def _merge(db: sqlite3.Connection, requests: Sequence[Sequence[RequestPart]]) -> None:
    """Writes requests of the log to the tables."""
    contexts: dict[str, tuple[JournalWriter, int]] = {}
    for part in (part for parts in requests for part in parts):
        writer = JournalWriter(db, ChangeInfo(part.number, part.stamp, part.author))
        writer.write(part)
        contexts[part.context] = writer, part.next_number
        db.execute(_REQUEST, (part.number, part.last, part.stamp, part.author, "change", part.context))
    for context, (writer, number) in contexts.items():
        writer.context(context, number)


def _columns(change_info: ChangeInfo) -> tuple[int, float, str]:
    """The values of the columns made, stamp and author."""
    return change_info.version, change_info.stamp, change_info.author
