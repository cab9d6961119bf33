"""Queries, validation, history and files of the world model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from skiros2_common.core.errors import SkirosError
from skiros2_gui.app.window import Window
from skiros2_world_model.core.changes import ONTOLOGY, SCENE
from skiros2_world_model.core.history import HistoryEntry, changed_lines
from skiros2_world_model.core.query_table import query_table
from skiros2_world_model.core.report import Report

#: The contexts of a query: all, the scene, the ontologies.
CONTEXTS = ("", SCENE, ONTOLOGY)
#: The most history entries read.
MAX_ENTRIES = 200
#: The most queries kept.
_MAX_QUERIES = 20


class _Store(Protocol):
    """The methods beyond the world model's interface."""

    def load(self, filename: str = "", context: str = SCENE) -> None: ...
    def save(self, filename: str = "", context: str = SCENE) -> None: ...
    def validate(self, context_id: str = SCENE) -> Report: ...
    def history(self, eid: str = "", *, limit: int = 0) -> list[HistoryEntry]: ...
    def query_ontology(self, query: str, cut_prefix: bool = True, context: str = "") -> list[str]: ...


@dataclass(frozen=True)
class Diagnostic:
    """Why a query failed.

    :param line, column: the position of the error, from 1; 0 if unknown.
    """

    text: str
    line: int = 0
    column: int = 0


@dataclass(frozen=True)
class Answer:
    """The result of a query.

    :param names: of the columns.
    """

    names: tuple[str, ...] = ()
    rows: tuple[tuple[Any, ...], ...] = ()


@dataclass(frozen=True)
class HistoryRow:
    """A change of an element.

    :param stamp: s since the epoch.
    :param lines: one line per change.
    """

    number: int
    stamp: float
    author: str
    lines: tuple[str, ...]


@dataclass
class ElementHistory:
    """The history of an element.

    :param entries: the newest first; None while being read.
    :param text: why there is none; "" if there is one.
    """

    eid: str = ""
    entries: tuple[HistoryRow, ...] | None = ()
    text: str = ""


@dataclass
class _Hooks:
    """Callbacks for new results."""

    answer: list[Callable[[], None]] = field(default_factory=list)
    report: list[Callable[[], None]] = field(default_factory=list)
    history: list[Callable[[], None]] = field(default_factory=list)


class WorldQueries:
    """Keeps the last result of each kind. Used by the Qt thread only; jobs make the blocking calls."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.answer: Answer | None = None
        self.diagnostic: Diagnostic | None = None
        self.queries: list[str] = []  #: earlier queries, the newest first
        self.report: Report | None = None
        self.history = ElementHistory()
        self.hooks = _Hooks()

    # -- queries -----------------------------------------------------------------------------------------------

    def ask(self, query: str, context: str = "") -> None:
        """Executes a SPARQL query on a context; "" for all."""
        store = self._store("executing the query")
        if store is None:
            return
        self.queries = [query, *(q for q in self.queries if q != query)][:_MAX_QUERIES]
        self.window.jobs.run(
            lambda: query_table(store, query, context),
            self._answered,
            self._not_answered,
            activity="executing the query",
            queue="query",
        )

    def _answered(self, found: tuple[list[str], list[list[Any]]]) -> None:
        names, rows = found
        if not names and rows:
            names = [f"{i + 1}" for i in range(len(rows[0]))]
        self.answer, self.diagnostic = Answer(tuple(names), tuple(map(tuple, rows))), None
        _call(self.hooks.answer)

    def _not_answered(self, error: Exception) -> None:
        line, column = error.position if isinstance(error, SkirosError) else (0, 0)
        self.answer, self.diagnostic = None, Diagnostic(str(error), line, column)
        _call(self.hooks.answer)

    # -- validation --------------------------------------------------------------------------------------------

    def validate(self) -> None:
        """Validates the scene against ontologies and shapes."""
        store = self._store("validating the scene")
        if store is not None:
            self.window.jobs.run(store.validate, self._validated, activity="validating the scene", queue="validation")

    def _validated(self, report: Report) -> None:
        self.report = report
        _call(self.hooks.report)

    # -- history -----------------------------------------------------------------------------------------------

    def fetch_history(self, eid: str) -> None:
        """Reads the history of an element; "" clears it."""
        self.history = ElementHistory(eid, None if eid else ())
        store = self._store("") if eid else None
        if store is not None:
            self.window.jobs.run(
                lambda: [history_row(entry) for entry in reversed(store.history(eid, limit=MAX_ENTRIES))],
                lambda entries: self._history_fetched(ElementHistory(eid, tuple(entries))),
                lambda error: self._history_fetched(ElementHistory(eid, (), str(error))),
                queue="history",
            )
        _call(self.hooks.history)

    def _history_fetched(self, past: ElementHistory) -> None:
        if past.eid == self.history.eid:  # otherwise another one was requested since
            self.history = past
            _call(self.hooks.history)

    # -- files -------------------------------------------------------------------------------------------------

    def load(self, filename: str) -> None:
        """Replaces the scene with a file's.

        :param filename: in the workspace of the world model; "" for the last one used.
        """
        self._with_file("loading", filename, lambda store: store.load(filename))

    def save(self, filename: str) -> None:
        """Writes the scene to a file; see `load`."""
        self._with_file("saving", filename, lambda store: store.save(filename))

    def _with_file(self, verb: str, filename: str, call: Callable[[_Store], None]) -> None:
        what = f"{verb} the scene ({filename})" if filename else f"{verb} the scene"
        store = self._store(what)
        if store is not None:
            self.window.jobs.run(lambda: call(store), activity=what, queue="world")

    def _store(self, what: str) -> _Store | None:
        world = self.window.system.world
        if world is None and what:
            self.window.problems.report(what, "there is no world model")
        return cast("_Store | None", world)


def history_row(entry: HistoryEntry) -> HistoryRow:
    """Converts a history entry."""
    lines = changed_lines(entry)
    if entry.action != "change":
        lines = [entry.action, *lines]
    return HistoryRow(entry.number, entry.stamp, entry.author, tuple(lines))




def _call(hooks: list[Callable[[], None]]) -> None:
    for hook in list(hooks):
        hook()
