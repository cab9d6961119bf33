"""The RDF side of the world model: one named graph per context, and SPARQL over them.

The scene index is the truth about the scene; the store is kept in step with it and answers queries. It is Oxigraph in
memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import WrongValue

Row = tuple[Any, ...]


class TripleStore:
    """Named graphs of triples. Safe to use from all threads."""

    def __init__(self) -> None:
        self._store = ox.Store()

    def replace(self, context: str, triples: Iterable[ox.Triple]) -> None:
        """Makes these the triples of a context."""
        graph = _graph(context)
        if self._store.contains_named_graph(graph):
            self._store.clear_graph(graph)
        self.extend(context, triples)

    def extend(self, context: str, triples: Iterable[ox.Triple]) -> None:
        """Adds triples to a context."""
        graph = _graph(context)
        self._store.bulk_extend(ox.Quad(t.subject, t.predicate, t.object, graph) for t in triples)

    def update(self, context: str, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> None:
        """Removes some triples from a context and adds others."""
        graph = _graph(context)
        for t in removed:
            self._store.remove(ox.Quad(t.subject, t.predicate, t.object, graph))
        self._store.extend(ox.Quad(t.subject, t.predicate, t.object, graph) for t in added)

    def triples(self, context: str, subject: Any = None, predicate: Any = None, obj: Any = None) -> list[ox.Triple]:
        """The triples of a context with that subject, predicate and object; None matches any."""
        found = self._store.quads_for_pattern(subject, predicate, obj, _graph(context))
        return [quad.triple for quad in found]

    def has(self, context: str, triple: ox.Triple) -> bool:
        """Whether a context has that triple."""
        return ox.Quad(triple.subject, triple.predicate, triple.object, _graph(context)) in self._store

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> list[Row]:
        """The rows that a SPARQL SELECT gives, each a tuple of terms (None: unbound); ASK gives one row of one bool.

        :param context: the one to ask; "" asks all.
        :param namespaces: by prefix, for prefixes that the query does not declare itself.
        :raises WrongValue: it does not parse, cannot be answered, or is an update.
        """
        scope: dict[str, Any] = {"default_graph": _graph(context)} if context else {"use_default_graph_as_union": True}
        try:
            answer = self._store.query(query, prefixes=dict(namespaces), **scope)
            if isinstance(answer, ox.QuerySolutions):
                return [tuple(row) for row in answer]
            if isinstance(answer, ox.QueryBoolean):
                return [(ox.Literal(bool(answer)),)]
            return [tuple(triple) for triple in answer]
        except (SyntaxError, ValueError, OSError, RuntimeError) as error:
            raise WrongValue(f"SPARQL query cannot be answered: {error}; the query was: {query}") from None


def _graph(context: str) -> ox.NamedNode:
    return ox.NamedNode(f"urn:skiros:context:{context}")
