"""The RDF side of the world model: one named graph per context, and SPARQL over them.

The scene index is the truth about the scenes, and the ontologies are always in memory; a store is kept in step with
them and answers queries. `OxigraphStore` is the default, in memory; `EndpointStore` is a SPARQL server elsewhere.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import islice, takewhile
from threading import Event
from typing import Any, Protocol

import pyoxigraph as ox

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_world_model.core.terms import RDF_TYPE
from skiros2_world_model.core.time_limit import TimeLimit

Row = tuple[Any, ...]

#: A query that takes longer is given up (s); so is one that has more rows.
QUERY_SECONDS = 10.0
QUERY_ROWS = 1_000_000

_CONTEXT = "urn:skiros:context:"


class TripleStore(Protocol):
    """Named graphs of triples, which follow the contexts of a world model. Safe to use from all threads.

    Changes are made under the world model's lock and must be quick; queries are asked without it.
    """

    @property
    def generation(self) -> int:
        """Another number than before: the store has lost the contexts, and is to be given them anew."""
        ...

    def prepare(self) -> None:
        """Called before contexts are brought up to date for a query, without the lock.

        :raises Refused: the store cannot be asked now.
        """
        ...

    def knowledge(self) -> list[ox.Triple]:
        """The classes and properties that the store holds besides the contexts, for the index over the ontologies."""
        ...

    def replace(self, context: str, triples: Iterable[ox.Triple]) -> None:
        """Makes these the triples of a context."""
        ...

    def extend(self, context: str, triples: Iterable[ox.Triple]) -> None:
        """Adds triples to a context."""
        ...

    def update(self, context: str, removed: Collection[ox.Triple], added: Collection[ox.Triple]) -> None:
        """Removes some triples from a context and adds others."""
        ...

    def rewrite(
        self,
        context: str,
        subjects: Collection[ox.NamedNode],
        removed: Collection[ox.Triple],
        added: Collection[ox.Triple],
    ) -> None:
        """Likewise, after all that is said of some subjects has gone but their relations to what has an IRI."""
        ...

    def triples(self, context: str) -> list[ox.Triple]:
        """The triples of the ontologies, which need no store elsewhere."""
        ...

    def has(self, context: str, triple: ox.Triple) -> bool:
        """Whether the ontologies have that triple."""
        ...

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> list[Row]:
        """The rows that a SPARQL SELECT gives, each a tuple of terms (None: unbound); ASK gives one row of one bool.

        CONSTRUCT and DESCRIBE give triples.

        :param context: the one to ask; "" asks all.
        :param namespaces: by prefix, for prefixes that the query does not declare itself.
        :raises WrongValue: it does not parse (the text tells line and column), is an update, or has too many rows.
        :raises TimedOut: it takes too long.
        :raises Refused: the store cannot be asked now.
        """
        ...


class OxigraphStore:
    """Named graphs in memory. See `TripleStore`.

    :param seconds, rows: a query that takes longer, or has more, is given up.
    """

    generation = 0

    def __init__(self, seconds: float = QUERY_SECONDS, rows: int = QUERY_ROWS) -> None:
        self._store = ox.Store()
        self._limit = TimeLimit(seconds)
        self._rows = rows

    def prepare(self) -> None:
        """It can always be asked."""

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

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> list[Row]:
        scope: dict[str, Any] = (
            {"default_graph": graph_of(context)} if context else {"use_default_graph_as_union": True}
        )

        def work(abandoned: Event) -> list[Row]:
            answer = self._store.query(query, prefixes=dict(namespaces), **scope)
            if isinstance(answer, ox.QueryBoolean):
                return [(ox.Literal(bool(answer)),)]
            some = takewhile(lambda _: not abandoned.is_set(), answer)
            return [tuple(row) for row in islice(some, self._rows + 1)]

        try:
            rows = self._limit.run(work, f"SPARQL query: {query}")
        except (SyntaxError, ValueError, OSError, RuntimeError) as error:
            if isinstance(error, SkirosError):
                raise
            raise WrongValue(f"SPARQL query cannot be answered: {error}; the query was: {query}") from None
        check_count(rows, self._rows, query)
        return rows


def check_count(rows: Collection[Any], most: int, query: str) -> None:
    """:raises WrongValue: a query has more rows than that."""
    if len(rows) > most:
        raise WrongValue(f"SPARQL query has more than {most} rows; expected a LIMIT: {query}")


def check_query(query: str, namespaces: Mapping[str, str]) -> None:
    """Whether a text is a SPARQL query.

    :raises WrongValue: it is not, or it is an update.
    """
    try:
        ox.Store().query(query, prefixes=dict(namespaces))
    except (SyntaxError, ValueError) as error:
        raise WrongValue(f"SPARQL query cannot be answered: {error}; the query was: {query}") from None


def graph_of(context: str) -> ox.NamedNode:
    """The named graph of a context."""
    return ox.NamedNode(_CONTEXT + context)
