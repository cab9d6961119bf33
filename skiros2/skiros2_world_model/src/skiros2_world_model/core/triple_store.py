"""Triple stores: one named graph per context, and SPARQL over them.

The scene index is authoritative. A store follows it (`GraphSync`) and answers queries. `OxigraphStore`, in memory, is
the default; `EndpointStore` uses a SPARQL server.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import Future
from itertools import islice, takewhile
from queue import SimpleQueue
from threading import Event
from typing import Any, NamedTuple, Protocol, TypeVar

import pyoxigraph as ox

from skiros2_common.core.errors import Refused, SkirosError, TimedOut, WrongValue
from skiros2_world_model.core.rdf import RDF_TYPE

_Result = TypeVar("_Result")

#: The maximum number of abandoned calls that may still be running, to limit the processor load.
_MAX_ABANDONED = 2


class TimeLimit:
    """Runs functions in background threads and abandons those that take too long.

    An abandoned call runs on until it checks its event, or ends by itself. While too many are running, new calls are
    refused. Thread-safe.

    :param seconds: the timeout (s); 0: none.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._overdue: dict[Future[Any], str] = {}
        self._lock = threading.Lock()

    def run(self, work: Callable[[threading.Event], _Result], what: str) -> _Result:
        """Runs `work` and returns its result, or raises its exception.

        :param work: gets an event that is set when the call is abandoned.
        :param what: describes the work in error messages.
        :raises TimedOut: the work takes too long.
        :raises Refused: too many abandoned calls are still running.
        """
        with self._lock:
            if len(self._overdue) >= _MAX_ABANDONED:
                running = "; ".join(self._overdue.values())
                raise Refused(f"{what}: refused while abandoned calls are still running: {running}")
        future: Future[_Result] = Future()
        abandoned = threading.Event()
        done = threading.Lock()  # released at the end; ten times faster than waiting for the future
        done.acquire()

        def serve() -> None:
            try:
                future.set_result(work(abandoned))
            except Exception as error:
                # Drop the frames: their variables, such as answers of Oxigraph, may have to be freed in this thread.
                future.set_exception(error.with_traceback(None))
            with self._lock:
                self._overdue.pop(future, None)
            done.release()

        _in_a_thread(serve)
        if not done.acquire(timeout=self._seconds or -1):
            with self._lock:
                if not future.done():
                    self._overdue[future] = what
                    abandoned.set()
                    raise TimedOut(f"{what}: abandoned after {self._seconds:g} s")
        return future.result()


#: The inboxes of idle threads, which are reused: starting a thread takes longer than most work.
_idle: list[SimpleQueue[Callable[[], None]]] = []


def _in_a_thread(work: Callable[[], None]) -> None:
    try:
        inbox = _idle.pop()
    except IndexError:
        inbox = SimpleQueue()
        threading.Thread(target=_work, args=(inbox,), name="time-limit", daemon=True).start()
    inbox.put(work)


def _work(inbox: SimpleQueue[Callable[[], None]]) -> None:
    while True:
        inbox.get()()
        _idle.append(inbox)


#: A term of an answer; None: unbound.
Term = ox.NamedNode | ox.BlankNode | ox.Literal | ox.Triple | None

Row = tuple[Any, ...]


class Answer(NamedTuple):
    """The answer to a query: the names of the columns, and rows of terms (None: unbound).

    ASK has one row of one boolean literal and no names; CONSTRUCT and DESCRIBE have the triples as rows.
    """

    names: list[str]
    rows: list[Row]


#: The names of the columns of triples.
TRIPLE = ["subject", "predicate", "object"]

#: The default limits of a query: time (s) and number of rows.
QUERY_SECONDS = 10.0
QUERY_ROWS = 1_000_000

_CONTEXT = "urn:skiros:context:"


#: pyoxigraph reports a syntax error only as a text.
_SYNTAX_ERROR = re.compile(r"error at (\d+):(\d+): (.*)", re.DOTALL)
#: Longer reasons, which list all expected tokens, are replaced.
_MAX_REASON = 120


class QueryError(WrongValue):
    """A SPARQL query that cannot be answered; `position` is that of a syntax error.

    :param text: the error text of pyoxigraph.
    """

    code = "wrong_query"

    def __init__(self, text: str, query: str) -> None:
        found = _SYNTAX_ERROR.fullmatch(text)
        reason = " ".join(text.split())
        if found is not None:
            self.position = int(found[1]), int(found[2])
            reason = " ".join(found[3].split())
            if "Prefix not found" in reason:
                reason = "unknown prefix (declare it: PREFIX name: <...>)"
            elif len(reason) > _MAX_REASON or "[_]" in reason:
                reason = "unexpected token"
            reason = f"line {found[1]}, column {found[2]}: {reason}"
        super().__init__(f"SPARQL query cannot be answered: {reason}; the query was: {query}")


class TripleStore(Protocol):
    """Named graphs for the contexts of a world model. Thread-safe.

    Writes are called under the world model's lock and must return quickly; queries are called without it.
    """

    @property
    def generation(self) -> int:
        """Changes when the store has lost its content; then all contexts must be written again."""
        ...

    def prepare(self) -> None:
        """Called without the lock before contexts are written for a query.

        :raises Refused: the store is not available.
        """
        ...

    def knowledge(self) -> list[ox.Triple]:
        """The classes and properties that the store holds besides the contexts, for the index of the ontologies."""
        ...

    def replace(self, context: str, triples: Iterable[ox.Triple]) -> None:
        """Replaces the triples of a context."""
        ...

    def extend(self, context: str, triples: Iterable[ox.Triple]) -> None:
        """Adds triples to a context."""
        ...

    def update(self, context: str, removed: Collection[ox.Triple], added: Collection[ox.Triple]) -> None:
        """Removes triples from a context and adds others."""
        ...

    def rewrite(
        self,
        context: str,
        subjects: Collection[ox.NamedNode],
        removed: Collection[ox.Triple],
        added: Collection[ox.Triple],
    ) -> None:
        """As `update`, after removing all triples of the subjects except relations to IRIs."""
        ...

    def triples(self, context: str) -> list[ox.Triple]:
        """The triples of the ontologies, from memory."""
        ...

    def has(self, context: str, triple: ox.Triple) -> bool:
        """Whether the ontologies have a triple."""
        ...

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> Answer:
        """Runs a SPARQL query.

        :param context: the context to query; "": all.
        :param namespaces: by prefix, for prefixes that the query does not declare.
        :raises QueryError: the query does not parse, or is an update.
        :raises WrongValue: it has too many rows.
        :raises TimedOut: the query takes too long.
        :raises Refused: the store is not available.
        """
        ...


class OxigraphStore:
    """Named graphs in memory. See `TripleStore`.

    :param seconds, rows: the limits of a query.
    """

    generation = 0

    def __init__(self, seconds: float = QUERY_SECONDS, rows: int = QUERY_ROWS) -> None:
        self._store = ox.Store()
        self._limit = TimeLimit(seconds)
        self._rows = rows

    def prepare(self) -> None:
        """No preparation: the store is always available."""

    def knowledge(self) -> list[ox.Triple]:
        return []

    def replace(self, context: str, triples: Iterable[ox.Triple]) -> None:
        graph = graph_of(context)
        if self._store.contains_named_graph(graph):
            self._store.clear_graph(graph)
        self.extend(context, triples)

    def extend(self, context: str, triples: Iterable[ox.Triple]) -> None:
        graph = graph_of(context)
        self._store.bulk_extend(ox.Quad(t.subject, t.predicate, t.object, graph) for t in triples)

    def update(self, context: str, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> None:
        graph = graph_of(context)
        for t in removed:
            self._store.remove(ox.Quad(t.subject, t.predicate, t.object, graph))
        self._store.extend(ox.Quad(t.subject, t.predicate, t.object, graph) for t in added)

    def rewrite(
        self,
        context: str,
        subjects: Collection[ox.NamedNode],
        removed: Collection[ox.Triple],
        added: Collection[ox.Triple],
    ) -> None:
        graph, gone = graph_of(context), set(removed)
        for subject in subjects:
            for quad in self._store.quads_for_pattern(subject, None, None, graph):
                if quad.predicate == RDF_TYPE or not isinstance(quad.object, ox.NamedNode):
                    gone.add(quad.triple)
        self.update(context, gone.difference(added), added)

    def triples(self, context: str) -> list[ox.Triple]:
        return [quad.triple for quad in self._store.quads_for_pattern(None, None, None, graph_of(context))]

    def has(self, context: str, triple: ox.Triple) -> bool:
        return ox.Quad(triple.subject, triple.predicate, triple.object, graph_of(context)) in self._store

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> Answer:
        scope: dict[str, Any] = (
            {"default_graph": graph_of(context)} if context else {"use_default_graph_as_union": True}
        )

        def run_query(abandoned: Event) -> Answer:
            found = self._store.query(query, prefixes=dict(namespaces), **scope)
            if isinstance(found, ox.QueryBoolean):
                return Answer([], [(ox.Literal(bool(found)),)])
            names = [name.value for name in found.variables] if isinstance(found, ox.QuerySolutions) else TRIPLE
            rows = takewhile(lambda _: not abandoned.is_set(), found)
            return Answer(names, [tuple(row) for row in islice(rows, self._rows + 1)])

        try:
            answer = self._limit.run(run_query, f"SPARQL query: {query}")
        except (SyntaxError, ValueError, OSError, RuntimeError) as error:
            if isinstance(error, SkirosError):
                raise
            raise QueryError(str(error), query) from None
        check_count(answer.rows, self._rows, query)
        return answer


def check_count(rows: Collection[Any], most: int, query: str) -> None:
    """:raises WrongValue: a query has more rows than that."""
    if len(rows) > most:
        raise WrongValue(f"SPARQL query has more than {most} rows; expected a LIMIT: {query}")


def check_query(query: str, namespaces: Mapping[str, str]) -> None:
    """Checks that a text is a SPARQL query.

    :raises QueryError: it does not parse, or is an update.
    """
    try:
        ox.Store().query(query, prefixes=dict(namespaces))
    except (SyntaxError, ValueError) as error:
        raise QueryError(str(error), query) from None


def graph_of(context: str) -> ox.NamedNode:
    """The named graph of a context."""
    return ox.NamedNode(_CONTEXT + context)
