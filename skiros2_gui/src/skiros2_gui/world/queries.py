"""Queries, validation, history and files of the world model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, cast

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.operations import ONTOLOGY, SCENE
from skiros2_gui.app.window import Window
from skiros2_world_model.core.history import HistoryEntry
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
    def query_table(self, query: str, context: str = "") -> tuple[list[str], list[list[Any]]]: ...


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


@dataclass
class ElementHistory:
    """The history of an element.

    :param entries: the newest first; None while being read.
    :param text: why there is none; "" if there is one.
    """

    eid: str = ""
    entries: tuple[HistoryEntry, ...] | None = ()
    text: str = ""


class WorldQueries:
    """Keeps the last result of each kind. Used by the Qt thread only; jobs make the blocking calls.

    The views set `on_answer`, `on_report` and `on_history`, which are called with new results.
    """

    def __init__(self, window: Window) -> None:
        self.window = window
        self.answer: Answer | None = None
        self.diagnostic: Diagnostic | None = None
        self.queries: list[str] = []  #: earlier queries, the newest first
        self.report: Report | None = None
        self.history = ElementHistory()
        self.on_answer: Callable[[], None] = _nothing
        self.on_report: Callable[[], None] = _nothing
        self.on_history: Callable[[], None] = _nothing

    # -- queries -----------------------------------------------------------------------------------------------

    def ask(self, query: str, context: str = "") -> None:
        """Executes a SPARQL query on a context; "" for all."""
        store = self._store("executing the query")
        if store is None:
            return
        self.queries = [query, *(q for q in self.queries if q != query)][:_MAX_QUERIES]
        self.window.jobs.run(
            lambda: store.query_table(query, context),
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
        self.on_answer()

    def _not_answered(self, error: Exception) -> None:
        line, column = error.position if isinstance(error, SkirosError) else (0, 0)
        self.answer, self.diagnostic = None, Diagnostic(str(error), line, column)
        self.on_answer()

    # -- validation --------------------------------------------------------------------------------------------

    def validate(self) -> None:
        """Validates the scene against ontologies and shapes."""
        store = self._store("validating the scene")
        if store is not None:
            self.window.jobs.run(store.validate, self._validated, activity="validating the scene", queue="validation")

    def _validated(self, report: Report) -> None:
        self.report = report
        self.on_report()

    # -- history -----------------------------------------------------------------------------------------------

    def fetch_history(self, eid: str) -> None:
        """Reads the history of an element; "" clears it."""
        self.history = ElementHistory(eid, None if eid else ())
        store = self._store("") if eid else None
        if store is not None:
            self.window.jobs.run(
                lambda: store.history(eid, limit=MAX_ENTRIES),
                lambda entries: self._history_fetched(ElementHistory(eid, tuple(reversed(entries)))),
                lambda error: self._history_fetched(ElementHistory(eid, (), str(error))),
                queue="history",
            )
        self.on_history()

    def _history_fetched(self, past: ElementHistory) -> None:
        if past.eid == self.history.eid:  # otherwise another one was requested since
            self.history = past
            self.on_history()

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


def _nothing() -> None:
    """The default callback."""
