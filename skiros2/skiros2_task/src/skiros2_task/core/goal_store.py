"""The goals of a task manager in a file, so that a restarted task manager continues with them.

Each call that changes a goal is one transaction, synchronised to disk: a goal that was accepted, and a step that was
started, are known after a power failure.
"""

from __future__ import annotations

import json
import logging
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from skiros2_common.core.errors import ConfigurationError, SkirosError, WrongValue
from skiros2_common.core.file_lock import own_file

log = logging.getLogger(__name__)

#: The number of ended goals whose results are kept.
ENDED_GOALS = 1000

_VERSION = 1

# status: of actionlib once the goal has ended, else NULL; number: orders the goals
_SCHEMA = """
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS goals (
    number INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT UNIQUE NOT NULL, request TEXT NOT NULL, progress TEXT NOT NULL,
    status INTEGER, text TEXT NOT NULL, result TEXT NOT NULL, delivered INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS steps (
    goal TEXT NOT NULL, number INTEGER NOT NULL, step TEXT NOT NULL, run TEXT NOT NULL, state TEXT NOT NULL,
    turn INTEGER NOT NULL, message TEXT NOT NULL, explanations TEXT NOT NULL, PRIMARY KEY (goal, number));
CREATE TABLE IF NOT EXISTS policies (
    number INTEGER PRIMARY KEY AUTOINCREMENT, goal TEXT UNIQUE NOT NULL, on_restart TEXT NOT NULL);
"""


class OnRestart(StrEnum):
    """The treatment of a goal when the task manager was restarted."""

    #: ASK if a robot of the goal holds something and its step no longer runs, or if the scene is another one;
    #: else CONTINUE.
    DEFAULT = ""
    CONTINUE = "continue"
    #: No further step starts until somebody decides.
    ASK = "ask"
    #: Running steps are stopped, and the goal ends as failed.
    ABORT = "abort"

    @classmethod
    def named(cls, text: str) -> OnRestart:
        """
        :raises WrongValue: the text names none.
        """
        try:
            return cls(text)
        except ValueError:
            raise WrongValue(f'on_restart is {text!r}, expected continue, ask, abort or ""') from None


class StoreFailed(SkirosError):
    """The file cannot be read or written."""


@dataclass(frozen=True)
class StoredStep:
    """A step of a goal that has not ended.

    :param step: see `step_codec`.
    :param run: the id of its run on the manager; "": it was not started.
    :param state: of a `StepState`.
    :param turn: orders the starts.
    :param explanations: as JSON data.
    """

    number: int
    step: dict[str, Any]
    run: str
    state: str
    turn: int = 0
    message: str = ""
    explanations: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class StoredGoal:
    """A goal.

    :param request: as JSON data, with the time stamp of its id.
    :param progress: further state of the execution, as JSON data.
    """

    id: str
    request: dict[str, Any]
    progress: dict[str, Any]
    steps: list[StoredStep]


@dataclass(frozen=True)
class StoredResult:
    """The result of an ended goal.

    :param status: of actionlib.
    :param delivered: whether the process lived on after the result was published.
    """

    id: str
    request: dict[str, Any]
    status: int
    text: str
    result: dict[str, Any]
    delivered: bool


class GoalStore:
    """The file. Any thread. All methods raise `StoreFailed` if the file cannot be read or written.

    :param path: created if it does not exist, with its folder; readable by the owner only.
    :raises ConfigurationError: another process uses the file, or it is not a store of this version.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._mutex = threading.Lock()
        self._delivered: list[str] = []
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch(0o600)
            self._lock = own_file(path)
            self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            version = self._db.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, _VERSION):
                raise ConfigurationError(f"{path} has version {version}, expected {_VERSION}")
            self._db.executescript(f"{_SCHEMA} PRAGMA user_version = {_VERSION};")
        except (OSError, sqlite3.Error) as error:
            raise ConfigurationError(f"the goals cannot be stored in {path}: {error}") from error

    def close(self, delivered: bool = False) -> None:
        """Closes the file.

        :param delivered: all results have reached their clients.
        """
        with self._mutex:
            try:
                if delivered:
                    self._db.execute("UPDATE goals SET delivered = 1 WHERE status IS NOT NULL")
            except sqlite3.Error as error:
                log.warning("%s: %s", self._path, error)
            self._db.close()
            self._lock.close()

    # -- goals -------------------------------------------------------------------------------------------------

    def accept(self, goal_id: str, request: Mapping[str, Any]) -> bool:
        """Stores a goal. Returns False if its id is known already."""
        with self._transaction() as db:
            done = db.execute(
                "INSERT OR IGNORE INTO goals (id, request, progress, text, result, delivered)"
                " VALUES (?,?,'{}','','',0)",
                (goal_id, json.dumps(request)),
            )
            return done.rowcount == 1

    def write(self, goal_id: str, progress: Mapping[str, Any], steps: Iterable[StoredStep]) -> None:
        """Stores the state of a goal's execution, and its new and changed steps."""
        rows = [
            (goal_id, s.number, json.dumps(s.step), s.run, s.state, s.turn, s.message, json.dumps(s.explanations))
            for s in steps
        ]
        with self._transaction() as db:
            db.execute("UPDATE goals SET progress = ? WHERE id = ?", (json.dumps(progress), goal_id))
            db.executemany(
                "INSERT OR REPLACE INTO steps (goal, number, step, run, state, turn, message, explanations)"
                " VALUES (?,?,?,?,?,?,?,?)",
                rows,
            )

    def end(self, goal_id: str, status: int, text: str, result: Mapping[str, Any]) -> None:
        """Stores the result of a goal, and forgets its steps and the oldest results."""
        with self._transaction() as db:
            values = (status, text, json.dumps(result), goal_id)
            db.execute("UPDATE goals SET status = ?, text = ?, result = ? WHERE id = ?", values)
            db.execute("DELETE FROM steps WHERE goal = ?", (goal_id,))
            for table, old in (("goals", "status IS NOT NULL AND"), ("policies", "")):
                last = f"SELECT number FROM {table} ORDER BY number DESC LIMIT 1 OFFSET {ENDED_GOALS}"
                db.execute(f"DELETE FROM {table} WHERE {old} number <= ({last})")

    def note_delivered(self, goal_id: str) -> None:
        """Notes that a result was published a while ago. Written with the next change."""
        with self._mutex:
            self._delivered.append(goal_id)

    def open_goals(self) -> list[StoredGoal]:
        """Returns the goals that have not ended, in the order of their acceptance."""
        goals = self._read("SELECT id, request, progress FROM goals WHERE status IS NULL ORDER BY number")
        return [StoredGoal(gid, json.loads(req), json.loads(prog), self._steps(gid)) for gid, req, prog in goals]

    def results(self) -> list[StoredResult]:
        """Returns the kept results, the oldest first."""
        rows = self._read(
            "SELECT id, request, status, text, result, delivered FROM goals WHERE status IS NOT NULL ORDER BY number"
        )
        return [
            StoredResult(gid, json.loads(request), status, text, json.loads(result), bool(delivered))
            for gid, request, status, text, result, delivered in rows
        ]

    def _steps(self, goal_id: str) -> list[StoredStep]:
        rows = self._read(
            "SELECT number, step, run, state, turn, message, explanations FROM steps WHERE goal = ? ORDER BY number",
            goal_id,
        )
        return [
            StoredStep(number, json.loads(step), run, state, turn, message, json.loads(why))
            for number, step, run, state, turn, message, why in rows
        ]

    # -- what a restart needs ----------------------------------------------------------------------------------

    def set_on_restart(self, goal_id: str, on_restart: OnRestart) -> None:
        """Stores what happens to a goal, which may be sent later, at a restart."""
        with self._transaction() as db:
            db.execute("DELETE FROM policies WHERE goal = ?", (goal_id,))
            db.execute("INSERT INTO policies (goal, on_restart) VALUES (?,?)", (goal_id, on_restart.value))

    def on_restart(self, goal_id: str) -> OnRestart | None:
        """Returns what was stored by `set_on_restart`; None: nothing."""
        rows = self._read("SELECT on_restart FROM policies WHERE goal = ?", goal_id)
        return OnRestart(rows[0][0]) if rows else None

    def set_meta(self, key: str, value: Any) -> None:
        """Stores JSON data about the system."""
        with self._transaction() as db:
            db.execute("INSERT OR REPLACE INTO meta (key, value) VALUES (?,?)", (key, json.dumps(value)))

    def meta(self, key: str) -> Any:
        """Returns the data stored by `set_meta`; None: nothing."""
        rows = self._read("SELECT value FROM meta WHERE key = ?", key)
        return json.loads(rows[0][0]) if rows else None

    # -- internals ---------------------------------------------------------------------------------------------

    def _read(self, query: str, *values: Any) -> list[Any]:
        with self._mutex:
            try:
                return self._db.execute(query, values).fetchall()
            except sqlite3.Error as error:
                raise StoreFailed(f"{self._path} cannot be read: {error}") from error

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._mutex:
            db = self._db
            try:
                db.execute("BEGIN IMMEDIATE")
                yield db
                delivered = [(goal_id,) for goal_id in self._delivered]
                db.executemany("UPDATE goals SET delivered = 1 WHERE id = ?", delivered)
                db.execute("COMMIT")
                self._delivered.clear()
            except sqlite3.Error as error:
                raise StoreFailed(f"{self._path} cannot be written: {error}") from error
            finally:
                if db.in_transaction:
                    db.execute("ROLLBACK")
