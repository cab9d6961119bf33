"""Keeps jobs, their history and the audit log in an SQLite file.

Each call is one transaction, which survives the end of the process once it has returned. It survives the end of the
machine once `synced` has returned after it; see `skiros2_gateway.core.group_sync`.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from skiros2_common.core.errors import ConfigurationError
from skiros2_gateway.core.group_sync import GroupSync
from skiros2_gateway.core.job import FINAL, Job
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.problems import StoreFailed

_VERSION = 1

_SCHEMA = """
CREATE TABLE IF NOT EXISTS jobs (
    id TEXT PRIMARY KEY, sequence INTEGER NOT NULL UNIQUE, state TEXT NOT NULL, cleared INTEGER NOT NULL,
    is_open INTEGER NOT NULL, ended REAL, outcome TEXT NOT NULL, document TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS open_jobs ON jobs (is_open, cleared, sequence);
CREATE INDEX IF NOT EXISTS outcomes_of_jobs ON jobs (outcome, state);
CREATE TABLE IF NOT EXISTS job_events (
    number INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL, time REAL NOT NULL, author TEXT NOT NULL,
    method TEXT NOT NULL, state TEXT NOT NULL, substate TEXT NOT NULL, comment TEXT NOT NULL);
CREATE INDEX IF NOT EXISTS events_of_job ON job_events (job, number);
CREATE TABLE IF NOT EXISTS audit (
    number INTEGER PRIMARY KEY AUTOINCREMENT, time REAL NOT NULL, user TEXT NOT NULL, way TEXT NOT NULL,
    action TEXT NOT NULL, object TEXT NOT NULL, outcome TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS sessions (
    id TEXT PRIMARY KEY, digest TEXT NOT NULL, user TEXT NOT NULL, credential TEXT NOT NULL, address TEXT NOT NULL,
    created REAL NOT NULL);
CREATE TABLE IF NOT EXISTS keys (
    number INTEGER PRIMARY KEY AUTOINCREMENT, user TEXT NOT NULL, key TEXT NOT NULL, digest TEXT NOT NULL,
    answer TEXT NOT NULL, UNIQUE (user, key));
CREATE TABLE IF NOT EXISTS signatures (signature TEXT PRIMARY KEY, sent REAL NOT NULL);
CREATE TABLE IF NOT EXISTS acknowledged (alarm TEXT PRIMARY KEY, user TEXT NOT NULL, time REAL NOT NULL);
CREATE TABLE IF NOT EXISTS latched (alarm TEXT PRIMARY KEY, document TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS figures (
    hour INTEGER NOT NULL, robot TEXT NOT NULL, kind TEXT NOT NULL, name TEXT NOT NULL, value REAL NOT NULL,
    PRIMARY KEY (hour, robot, kind, name)) WITHOUT ROWID;
"""

#: The audit entries that are kept at most, the newest: 100 MB.
_MAX_AUDIT = 500_000

#: How many jobs and audit entries `prune` removes at once, so that no command waits for long.
_PRUNED = 500

#: The idempotency keys of a user that are kept, the newest.
_MAX_KEYS = 2000


#: After how many transactions the write-ahead log is copied to the file: some 2 MB.
_CHECKPOINT = 100


class Numbers(NamedTuple):
    """Numbers of an entry of the jobs' history and of one of the audit log."""

    event: int
    audit: int


class FigureKey(NamedTuple):
    """Names a figure of a robot; see `skiros2_gateway.core.figures`."""

    robot: str
    kind: str
    name: str


NONE, ALL = Numbers(0, 0), Numbers(2**62, 2**62)


@dataclass(frozen=True)
class JobFilter:
    """Which jobs are wanted.

    :param state, outcome: empty: any.
    :param text: in the id, the description or the goal.
    :param begin, end: made between these times (s since the epoch).
    :param cleared: also those removed from the list.
    :param since: only jobs with a higher number.
    :param after: only jobs with a lower number; None: all.
    """

    state: Sequence[str] = ()
    outcome: Sequence[str] = ()
    text: str = ""
    begin: float | None = None
    end: float | None = None
    cleared: bool = False
    since: int = 0
    after: int | None = None

    def sql(self) -> tuple[str, list[Any]]:
        """Returns the condition of a query, and its values."""
        found: list[tuple[str, list[Any]]] = [("sequence > ?", [self.since])]
        if self.after is not None:
            found.append(("sequence < ?", [self.after]))
        if not self.cleared:
            found.append(("cleared = 0", []))
        for column, values in (("state", self.state), ("outcome", self.outcome)):
            if values:
                found.append((f"{column} IN ({', '.join('?' for _ in values)})", list(values)))
        for comparison, time in ((">=", self.begin), ("<", self.end)):
            if time is not None:
                found.append((f"json_extract(document, '$.created') {comparison} ?", [time]))
        if self.text:
            fields = ("id", "json_extract(document, '$.order.description')", "json_extract(document, '$.goal')")
            condition = " OR ".join(f"instr(lower({field}), ?)" for field in fields)
            found.append((f"({condition})", [self.text.lower()] * len(fields)))
        return " AND ".join(condition for condition, _ in found), [value for _, values in found for value in values]


class JobStore:
    """The file. To be used by one thread. Each method raises `StoreFailed` if the file cannot be read or written.

    :param path: created if it does not exist; its folder exists. ":memory:" keeps nothing.
    :raises ConfigurationError: the file is not a store of this version.
    """

    def __init__(self, path: Path | str) -> None:
        if str(path) != ":memory:":
            Path(path).touch(mode=0o600)
            Path(path).chmod(0o600)  # SQLite gives its other files the same mode
        self._sync: GroupSync | None = None
        self._written = 0
        self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        try:
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.execute("PRAGMA busy_timeout = 5000")
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, _VERSION):
                raise ConfigurationError(f"{path} has version {version} of the job store, expected {_VERSION}")
            self._db.executescript(_SCHEMA)
            self._db.execute(f"PRAGMA user_version = {_VERSION}")
            self._db.execute("PRAGMA synchronous = NORMAL")
            self._db.execute("PRAGMA wal_autocheckpoint = 0")
            if str(path) != ":memory:":
                self._sync = GroupSync(path)
        except sqlite3.DatabaseError as error:
            self._db.close()
            raise ConfigurationError(f"{path} is not a job store: {error}") from error

    def close(self) -> None:
        """Closes the file."""
        if self._sync is not None:
            self._sync.close()
        self._db.close()

    def request_sync(self) -> asyncio.Future[None]:
        """Returns a future that is done when all that was written is on the disk; see `GroupSync.request`."""
        if self._sync is not None:
            return self._sync.request()
        asyncio.get_running_loop().call_soon((done := asyncio.Future[None]()).set_result, None)
        return done

    async def synced(self) -> None:
        """Waits until all that was written is on the disk: an answer that promises it is sent afterwards."""
        await asyncio.shield(self.request_sync())

    def next_sequence(self) -> int:
        """Returns the number for the next job."""
        return int(self._read("SELECT COALESCE(MAX(sequence), 0) + 1 FROM jobs")[0][0])

    def save(self, job: Job, author: str, method: str, comment: str = "", data: dict[str, Any] | None = None) -> str:
        """Writes a new or changed job (`data`: of its `to_dict`), and an entry of its history. Returns it as JSON.

        :param author: the client or the part of the gateway that changed it.
        :param method: the ISA-95 method, or what happened in the cell.
        """
        with self._transaction() as db:
            text = _write_job(db, job, data)
            db.execute(
                "INSERT INTO job_events (job, time, author, method, state, substate, comment)"
                " VALUES (?, ?, ?, ?, ?, ?, ?)",
                (job.id, job.changed, author, method, job.state, job.substate, comment),
            )
        return text

    def save_progress(self, jobs: Sequence[Job]) -> None:
        """Writes changed jobs."""
        with self._transaction() as db:
            for job in jobs:
                _write_job(db, job)

    def get(self, job_id: str) -> Job | None:
        """Returns a job, also a cleared one."""
        rows = self._read("SELECT document FROM jobs WHERE id = ?", job_id)
        return Job.from_dict(json.loads(rows[0][0])) if rows else None

    def open_jobs(self) -> list[str]:
        """Returns the jobs that have not ended, or whose response is incomplete, as JSON in the order of their
        numbers.
        """
        return [text for (text,) in self._read("SELECT document FROM jobs WHERE is_open = 1 ORDER BY sequence")]

    def jobs(self, wanted: JobFilter | None = None, limit: int = 1000) -> Iterator[Job]:
        """Returns jobs, the newest first."""
        conditions, values = (wanted or JobFilter()).sql()
        rows = self._read(
            f"SELECT document FROM jobs WHERE {conditions} ORDER BY sequence DESC LIMIT ?", *values, limit
        )
        return (Job.from_dict(json.loads(document)) for (document,) in rows)

    def pages(self, wanted: JobFilter, limit: int) -> list[tuple[int, str]]:
        """Returns numbers and JSON texts (as of `Job.to_dict`) of jobs, the newest first."""
        conditions, values = wanted.sql()
        query = f"SELECT sequence, document FROM jobs WHERE {conditions} ORDER BY sequence DESC LIMIT ?"
        return self._read(query, *values, limit)

    def jobs_after(self, number: int, limit: int) -> list[Job]:
        """Returns jobs in the list with a higher number, the oldest first."""
        rows = self._read(
            "SELECT document FROM jobs WHERE cleared = 0 AND sequence > ? ORDER BY sequence LIMIT ?", number, limit
        )
        return [Job.from_dict(json.loads(document)) for (document,) in rows]

    def counts(self) -> dict[str, int]:
        """Returns how many jobs were in each outcome; those without one by their state."""
        return dict(
            self._read("SELECT CASE outcome WHEN '' THEN state ELSE outcome END, COUNT(*) FROM jobs GROUP BY 1")
        )

    def history(self, job_id: str) -> list[dict[str, Any]]:
        """Returns the changes of a job's state, the oldest first."""
        keys = ("number", "time", "author", "method", "state", "substate", "comment")
        rows = self._read(f"SELECT {', '.join(keys)} FROM job_events WHERE job = ? ORDER BY number", job_id)
        return [dict(zip(keys, row, strict=True)) for row in rows]

    def last_numbers(self) -> Numbers:
        """Returns the numbers of the newest entries."""
        (row,) = self._read(
            "SELECT (SELECT COALESCE(MAX(number), 0) FROM job_events), (SELECT COALESCE(MAX(number), 0) FROM audit)"
        )
        return Numbers(*row)

    def prune(self, before: float, dated: Numbers = ALL, old: Numbers = NONE) -> int:
        """Removes some of the jobs that ended before a time (s since the epoch), with their history, and of the older
        audit entries. Returns how many; 0: nothing is left to remove.

        Jobs that have not ended, or whose response is incomplete, stay.

        :param dated: the last entries whose time counts.
        :param old: the last entries that are old, whatever their time is.
        """
        with self._transaction() as db:
            # The last job stays: its number is the highest that was given.
            ended = db.execute(
                "SELECT id FROM jobs, (SELECT job, MAX(number) AS last FROM job_events GROUP BY job) ON id = job"
                " WHERE is_open = 0 AND (last <= ? OR ended < ? AND last <= ?)"
                " AND sequence < (SELECT MAX(sequence) FROM jobs) LIMIT ?",
                (old.event, before, dated.event, _PRUNED),
            ).fetchall()
            db.executemany("DELETE FROM job_events WHERE job = ?", ended)
            db.executemany("DELETE FROM jobs WHERE id = ?", ended)
            removed = db.execute(
                "DELETE FROM audit WHERE number IN (SELECT number FROM audit"
                " WHERE number <= ? OR time < ? AND number <= ? OR number <= (SELECT MAX(number) FROM audit) - ?"
                " ORDER BY number LIMIT ?)",
                (old.audit, before, dated.audit, _MAX_AUDIT, _PRUNED),
            ).rowcount
            db.execute("DELETE FROM figures WHERE hour < ?", (int(before // 3600.0),))
            db.execute("DELETE FROM acknowledged WHERE time < ?", (before,))
        return len(ended) + removed

    # -- the audit log -----------------------------------------------------------------------------------------

    def audit(self, entry: Mapping[str, Any]) -> None:
        """Writes an entry with the keys `time`, `user`, `way`, `action`, `object` and `outcome`."""
        with self._transaction() as db:
            db.execute(
                "INSERT INTO audit (time, user, way, action, object, outcome)"
                " VALUES (:time, :user, :way, :action, :object, :outcome)",
                entry,
            )

    def audit_log(self, since: int = 0, limit: int = 1000) -> list[dict[str, Any]]:
        """Returns entries with a higher number, the oldest first."""
        keys = ("number", "time", "user", "way", "action", "object", "outcome")
        rows = self._read(f"SELECT {', '.join(keys)} FROM audit WHERE number > ? ORDER BY number LIMIT ?", since, limit)
        return [dict(zip(keys, row, strict=True)) for row in rows]

    # -- sessions of the page ----------------------------------------------------------------------------------

    def put_session(self, entry: Mapping[str, Any]) -> None:
        """Writes a session with the keys `id`, `digest`, `user`, `credential`, `address` and `created`."""
        with self._transaction() as db:
            db.execute("INSERT INTO sessions VALUES (:id, :digest, :user, :credential, :address, :created)", entry)

    def delete_session(self, session_id: str) -> None:
        """Removes a session."""
        with self._transaction() as db:
            db.execute("DELETE FROM sessions WHERE id = ?", (session_id,))

    def sessions(self) -> list[dict[str, Any]]:
        """Returns the sessions as of `put_session`, the oldest first."""
        keys = ("id", "digest", "user", "credential", "address", "created")
        rows = self._read(f"SELECT {', '.join(keys)} FROM sessions ORDER BY created")
        return [dict(zip(keys, row, strict=True)) for row in rows]

    # -- idempotency keys --------------------------------------------------------------------------------------

    def find_key(self, user: str, key: str) -> tuple[str, str] | None:
        """Returns the command's digest and the answer of a key; the answer "" is not known yet."""
        rows = self._read("SELECT digest, answer FROM keys WHERE user = ? AND key = ?", user, key)
        return tuple(rows[0]) if rows else None

    def put_key(self, user: str, key: str, digest: str) -> None:
        """Writes a key without an answer."""
        with self._transaction() as db:
            db.execute("INSERT INTO keys (user, key, digest, answer) VALUES (?, ?, ?, '')", (user, key, digest))
            db.execute(
                "DELETE FROM keys WHERE user = ? AND number <= (SELECT number FROM keys WHERE user = ?"
                " ORDER BY number DESC LIMIT 1 OFFSET ?)",
                (user, user, _MAX_KEYS),
            )

    def answer_key(self, user: str, key: str, answer: str) -> None:
        """Writes the answer of a key."""
        with self._transaction() as db:
            db.execute("UPDATE keys SET answer = ? WHERE user = ? AND key = ?", (answer, user, key))

    def delete_key(self, user: str, key: str) -> None:
        """Removes a key."""
        with self._transaction() as db:
            db.execute("DELETE FROM keys WHERE user = ? AND key = ?", (user, key))

    # -- signatures of commands --------------------------------------------------------------------------------

    def signatures(self) -> dict[str, float]:
        """Returns the times of commands (s since the epoch) by their signatures, in the order of writing."""
        return dict(self._read("SELECT signature, sent FROM signatures ORDER BY rowid"))

    def put_signature(self, signature: str, sent: float, expired: Sequence[str]) -> None:
        """Writes the signature of a command that was sent at a time (s since the epoch); removes expired ones."""
        with self._transaction() as db:
            db.executemany("DELETE FROM signatures WHERE signature = ?", [(each,) for each in expired])
            db.execute("INSERT INTO signatures VALUES (?, ?)", (signature, sent))

    # -- alarms ------------------------------------------------------------------------------------------------

    def acknowledged(self) -> dict[str, dict[str, Any]]:
        """Returns {user, time} (s since the epoch) by the ids of alarms."""
        rows = self._read("SELECT alarm, user, time FROM acknowledged")
        return {alarm: {"user": user, "time": time} for alarm, user, time in rows}

    def put_acknowledged(self, alarms: Mapping[str, Mapping[str, Any]]) -> None:
        """Writes entries as of `acknowledged`."""
        rows = [(alarm, entry["user"], entry["time"]) for alarm, entry in alarms.items()]
        with self._transaction() as db:
            db.executemany("INSERT OR REPLACE INTO acknowledged VALUES (?, ?, ?)", rows)

    def latched(self) -> dict[str, dict[str, Any]]:
        """Returns the alarms by id that wait to be acknowledged; see `skiros2_gateway.core.alarms`."""
        return {alarm: json.loads(text) for alarm, text in self._read("SELECT alarm, document FROM latched")}

    def put_latched(self, alarms: Mapping[str, Mapping[str, Any]]) -> None:
        """Replaces the entries of `latched`."""
        with self._transaction() as db:
            db.execute("DELETE FROM latched")
            db.executemany("INSERT INTO latched VALUES (?, ?)", [(each, json_text(alarms[each])) for each in alarms])

    # -- figures -----------------------------------------------------------------------------------------------

    def add_figures(self, hour: int, values: Mapping[FigureKey, float]) -> None:
        """Adds to the figures of an hour (since the epoch)."""
        with self._transaction() as db:
            db.executemany(
                "INSERT INTO figures VALUES (?, ?, ?, ?, ?)"
                " ON CONFLICT DO UPDATE SET value = figures.value + excluded.value",
                [(hour, *key, value) for key, value in values.items()],
            )

    def figures(self, begin: int = 0, end: int = 2**62) -> dict[FigureKey, float]:
        """Returns the sums of figures over hours: from `begin`, before `end`."""
        query = "SELECT robot, kind, name, SUM(value) FROM figures WHERE hour >= ? AND hour < ? GROUP BY 1, 2, 3"
        return {FigureKey(*key): value for *key, value in self._read(query, begin, end)}

    def first_hours(self) -> dict[str, int]:
        """Returns the first hour (since the epoch) of which there are figures of each robot."""
        return dict(self._read("SELECT robot, MIN(hour) FROM figures GROUP BY robot"))

    def figures_by_hour(self, begin: int, end: int) -> list[tuple[int, str, str, float]]:
        """Returns (hour, kind, name, value), summed over robots, of hours from `begin`, before `end`."""
        query = "SELECT hour, kind, name, SUM(value) FROM figures WHERE hour >= ? AND hour < ? GROUP BY 1, 2, 3"
        return self._read(query, begin, end)

    def count_ended(self, begin: float, end: float, key: str, where: str = "TRUE") -> list[Any]:
        """Returns how many jobs have ended between two times (s since the epoch), by an SQL key, the most first."""
        query = f"SELECT {key}, COUNT(*) AS n FROM jobs WHERE ended >= ? AND ended < ? AND {where} GROUP BY {key}"
        return self._read(f"{query} ORDER BY n DESC, {key}", begin, end)

    # -- internals ---------------------------------------------------------------------------------------------

    def _read(self, query: str, *values: Any) -> list[Any]:
        try:
            return self._db.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise StoreFailed(f"the job store cannot be read: {error}") from error

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield self._db
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            if self._db.in_transaction:  # some errors have rolled it back already
                self._db.execute("ROLLBACK")
            raise StoreFailed(f"the job store cannot be written: {error}") from error
        self._written += 1
        if self._sync is not None and self._written % _CHECKPOINT == 0:
            self._sync.checkpoint()


def _write_job(db: sqlite3.Connection, job: Job, data: dict[str, Any] | None = None) -> str:
    response, text = job.response, json_text(data or job.to_dict())
    is_open = job.state not in FINAL or not response.collected
    row = (job.state, job.cleared, is_open, response.ended, response.outcome, text)
    db.execute(
        "INSERT INTO jobs (id, sequence, state, cleared, is_open, ended, outcome, document)"
        " VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (id) DO UPDATE SET state = excluded.state,"
        " cleared = excluded.cleared, is_open = excluded.is_open, ended = excluded.ended,"
        " outcome = excluded.outcome, document = excluded.document",
        (job.id, job.sequence, *row),
    )
    return text
