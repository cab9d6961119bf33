"""Triple stores: one named graph per context, and SPARQL over them.

The scene index is authoritative. A store follows it (`GraphSync`) and answers queries. `WorkerStore`, in processes of
its own, is the default; `EndpointStore` uses a SPARQL server.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import pyoxigraph as ox

from skiros2_common.core.errors import Refused, WrongValue
from skiros2_world_model.core.rdf import RDF_TYPE

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

#: The default limits of a query: time (s), number of rows, size of the rows (bytes) and memory (bytes).
QUERY_SECONDS = 10.0
QUERY_ROWS = 1_000_000
QUERY_BYTES = 256 << 20
QUERY_MEMORY = 1 << 30

#: The graphs of contexts begin with this.
CONTEXT_GRAPHS = "urn:skiros:context:"


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


class QueryNotAllowed(WrongValue):
    """A SPARQL query for more than the graphs of the world model."""

    code = "query_not_allowed"

    def __init__(self, reason: str, query: str) -> None:
        super().__init__(f"SPARQL query: {reason}; the query was: {query}")


class QueryTooLarge(WrongValue):
    """A SPARQL query that needs more rows, bytes or memory than the limits allow."""

    code = "query_too_large"

    def __init__(self, reason: str, query: str) -> None:
        super().__init__(f"SPARQL query {reason}: {query}")


class StoreLost(Refused):
    """The store has lost its content while it answered; all contexts must be written again."""


class TripleStore(Protocol):
    """Named graphs for the contexts of a world model. Thread-safe.

    Writes are called under the world model's lock and must return quickly; queries are called without it. Iterables
    that are written may be read later, without the lock: they must not change.
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

    def update(self, context: str, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> None:
        """Removes triples from a context, then adds others."""
        ...

    def rewrite(
        self,
        context: str,
        subjects: Iterable[ox.NamedNode],
        removed: Iterable[ox.Triple],
        added: Iterable[ox.Triple],
    ) -> None:
        """Same as `update`, after removing all triples of the subjects except relations to IRIs."""
        ...

    def triples(self, context: str) -> list[ox.Triple]:
        """The triples of the ontologies, from memory."""
        ...

    def has(self, context: str, triple: ox.Triple) -> bool:
        """Whether the ontologies have a triple."""
        ...

    def sync(self) -> None:
        """Brings the graphs up to date with what was written. Called without the lock, before a query.

        :raises Refused: the store is not available.
        """
        ...

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> Answer:
        """Runs a SPARQL query.

        :param context: the context to query; "": all.
        :param namespaces: by prefix, for prefixes that the query does not declare.
        :raises QueryError: the query does not parse, or is an update.
        :raises QueryNotAllowed: it uses SERVICE, LOAD or FROM.
        :raises QueryTooLarge: it needs more rows, bytes or memory than the limits allow.
        :raises TimedOut: the query takes too long.
        :raises Refused: the store is not available.
        """
        ...


#: A store with this number of removed triples, and more of them than this part of the others, is copied.
_WORN, _WORN_PART = 2_000, 0.05


class Graphs:
    """Named graphs in memory, without queries. One thread writes; any number read.

    Oxigraph keeps removed triples and becomes slower with them, so a store with many of them is replaced by a copy.
    """

    def __init__(self) -> None:
        self.store = ox.Store()
        self.copies = True  #: whether it may be replaced
        self._removed, self._worn = 0.0, float(_WORN)

    @property
    def is_worn(self) -> bool:
        """Whether enough triples were removed that a copy is better."""
        return self._removed > self._worn

    def clear(self, context: str) -> None:
        """Removes all triples of a context."""
        graph = graph_of(context)
        if self.store.contains_named_graph(graph):
            self._removed += self._worn + 1  # as each of its triples is still there
            self.store.clear_graph(graph)

    def forget(self, context: str, subjects: Iterable[ox.NamedNode]) -> None:
        """Removes all triples of the subjects except relations to IRIs."""
        for subject in subjects:
            quads = self.store.quads_for_pattern(subject, None, None, graph_of(context))
            self.remove([q for q in quads if q.predicate == RDF_TYPE or not isinstance(q.object, ox.NamedNode)])

    def update(self, context: str, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> None:
        """Removes triples from a context, then adds others."""
        self.remove(_quads(context, removed))
        self.add(_quads(context, added))

    def remove(self, quads: Iterable[ox.Quad]) -> None:
        for quad in quads:
            self.store.remove(quad)
            self._removed += 1

    def add(self, quads: Iterable[ox.Quad]) -> None:
        if self.is_worn and self.copies:
            copy = ox.Store()
            copy.bulk_extend(self.store)
            self.store, self._removed, self._worn = copy, 0.0, max(_WORN, len(copy) * _WORN_PART)
        self.store.bulk_extend(quads)

    def triples(self, context: str) -> list[ox.Triple]:
        return [quad.triple for quad in self.store.quads_for_pattern(None, None, None, graph_of(context))]

    def has(self, context: str, triple: ox.Triple) -> bool:
        return ox.Quad(triple.subject, triple.predicate, triple.object, graph_of(context)) in self.store


def _quads(context: str, triples: Iterable[ox.Triple]) -> Iterator[ox.Quad]:
    graph = graph_of(context)
    return (ox.Quad(t.subject, t.predicate, t.object, graph) for t in triples)


def check_count(rows: Collection[Any], most: int, query: str) -> None:
    """:raises WrongValue: a query has more rows than that."""
    if len(rows) > most:
        raise QueryTooLarge(f"has more than {most} rows; expected a LIMIT", query)


def graph_of(context: str) -> ox.NamedNode:
    """The named graph of a context."""
    return ox.NamedNode(CONTEXT_GRAPHS + context)
