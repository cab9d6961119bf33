"""A triple store in a SPARQL 1.1 endpoint, which may hold other graphs, too."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import pyoxigraph as ox
from rdflib import Literal, URIRef

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError
from skiros2_world_model.core.changes import ONTOLOGY
from skiros2_world_model.core.endpoint_connection import EndpointConnection, without_password
from skiros2_world_model.core.prefixes import OWL, RDF, RDFS
from skiros2_world_model.core.rdflib_terms import store_term
from skiros2_world_model.core.triple_store import (
    QUERY_ROWS,
    QUERY_SECONDS,
    OxigraphStore,
    Row,
    check_count,
    check_query,
    graph_of,
)

#: The maximum number of triples in one request.
_CHUNK = 5_000

#: Requests are joined up to this length (characters).
_LARGE = 1_000_000

#: The prefix of IRIs that replace blank nodes, as later requests cannot refer to blank nodes.
_BLANK = "urn:skiros:blank:"

#: The graph with the owner and the list of our graphs: `<session> rdf:value "name"; rdfs:member <graph>`.
_SESSION = "<urn:skiros:session>"

_VALUE, _MEMBER, _TYPE = f"<{RDF}value>", f"<{RDFS}member>", f"<{RDF}type>"

#: Selects declarations from the endpoint's own graphs, without blank nodes, to which no later query can refer.
_KNOWLEDGE = f"""PREFIX owl: <{OWL}> PREFIX rdfs: <{RDFS}> PREFIX rdf: <{RDF}>
SELECT DISTINCT ?s ?p ?o {{
  {{ VALUES ?o {{ owl:Ontology owl:Class rdfs:Class owl:ObjectProperty owl:DatatypeProperty rdf:Property }}
     BIND(rdf:type AS ?p) ?s ?p ?o }}
  UNION {{ VALUES ?p {{ rdfs:subClassOf owl:equivalentClass rdfs:subPropertyOf rdfs:range }} ?s ?p ?o }}
  FILTER(isIRI(?s) && isIRI(?o))
}}"""


class EndpointStore:
    """The contexts as named graphs `urn:skiros:context:<name>` of an endpoint. See `TripleStore`.

    Other graphs of the endpoint stay unchanged and can be queried. Changes are queued and sent in large requests before
    the next query. While the endpoint is down, queries are refused; when it is back, or was replaced, all contexts are
    written again. The ontologies are also kept in memory, for queries of `ontology` only.

    Only one world model may use an endpoint at a time.

    :param query_url, update_url: the endpoint; "" as the second: the first URL takes updates, too.
    :param seconds: the timeout of an answer (s).
    :param rows: the maximum number of rows of a query.
    :raises ConfigurationError: the endpoint cannot be used.
    """

    def __init__(
        self, query_url: str, update_url: str = "", seconds: float = QUERY_SECONDS, rows: int = QUERY_ROWS
    ) -> None:
        self._url = query_url
        self._connection = EndpointConnection(query_url, update_url or query_url, seconds)
        self._rows = rows
        self._ontologies = OxigraphStore(seconds, rows)
        self._name = str(uuid.uuid4())
        self._sending = threading.Lock()  # held while the endpoint is written to
        self._lock = threading.RLock()  # guards the fields below; never held while waiting for the endpoint
        self._requests: list[str] = []  # not sent yet
        self._lost = True  # whether the endpoint may have lost our graphs
        self._claimed = False  # whether our session graph has been written
        self.generation = 0
        try:
            self.prepare()
            self._send()
            self._check_graphs()
            self._knowledge = [ox.Triple(*map(store_term, row)) for row in self._ask(_KNOWLEDGE)]
        except SkirosError as error:
            raise ConfigurationError(str(error)) from None

    def prepare(self) -> None:
        """Checks that the endpoint answers and still has our graphs; otherwise starts again."""
        with self._sending:
            found = self._ask(f"SELECT ?name {{ GRAPH {_SESSION} {{ {_SESSION} {_VALUE} ?name }} }}")
            names = {str(row[0]) for row in found}
            if self.generation and names - {self._name}:
                raise Refused(f"SPARQL endpoint {without_password(self._url)} is used by another world model now")
            if self._lost or (self._claimed and not names):
                self._restart()

    def knowledge(self) -> list[ox.Triple]:
        return self._knowledge

    def replace(self, context: str, triples: Iterable[ox.Triple]) -> None:
        graph, given = graph_of(context), list(triples)
        with self._lock:
            if context == ONTOLOGY:
                self._ontologies.replace(context, given)
            self._enqueue(f"CLEAR SILENT GRAPH {graph}")
            self._enqueue(f"INSERT DATA {{ GRAPH {_SESSION} {{ {_SESSION} {_MEMBER} {graph} }} }}")
            self._write("INSERT", context, given)

    def extend(self, context: str, triples: Iterable[ox.Triple]) -> None:
        self.update(context, (), list(triples))

    def update(self, context: str, removed: Collection[ox.Triple], added: Collection[ox.Triple]) -> None:
        with self._lock:
            if context == ONTOLOGY:
                self._ontologies.update(context, removed, added)
            self._write("DELETE", context, removed)
            self._write("INSERT", context, added)

    def rewrite(
        self,
        context: str,
        subjects: Collection[ox.NamedNode],
        removed: Collection[ox.Triple],
        added: Collection[ox.Triple],
    ) -> None:
        graph = graph_of(context)
        with self._lock:
            for some in _chunks(map(str, subjects)):
                pattern = f"GRAPH {graph} {{ ?s ?p ?o }}"
                no_relation = f'?p = {_TYPE} || !isIRI(?o) || STRSTARTS(STR(?o), "{_BLANK}")'
                values = f"VALUES ?s {{ {' '.join(some)} }}"
                self._enqueue(f"DELETE {{ {pattern} }} WHERE {{ {values} {pattern} FILTER({no_relation}) }}")
            self.update(context, removed, added)

    def triples(self, context: str) -> list[ox.Triple]:
        return self._ontologies.triples(context)

    def has(self, context: str, triple: ox.Triple) -> bool:
        return self._ontologies.has(context, triple)

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> list[Row]:
        if context == ONTOLOGY:
            return self._ontologies.query(query, context, namespaces)
        check_query(query, namespaces)
        self._send()
        graph = URIRef(graph_of(context).value) if context else None
        return [tuple(map(_read, row)) for row in self._ask(query, graph, namespaces)]

    def _restart(self) -> None:
        """Drops all graphs of world models; the contexts must be written again."""
        graphs = self._ask(f"SELECT ?graph {{ GRAPH {_SESSION} {{ {_SESSION} {_MEMBER} ?graph }} }}")
        with self._lock:
            self._lost = self._claimed = False
            self.generation += 1
            self._requests = [f"DROP SILENT GRAPH <{row[0]}>" for row in graphs]
            self._enqueue(f"DROP SILENT GRAPH {_SESSION}")
            self._enqueue(f'INSERT DATA {{ GRAPH {_SESSION} {{ {_SESSION} {_VALUE} "{self._name}" }} }}')
            self.replace(ONTOLOGY, self._ontologies.triples(ONTOLOGY))

    def _write(self, verb: str, context: str, triples: Iterable[ox.Triple]) -> None:
        for some in _chunks(map(_written, triples)):
            self._enqueue(f"{verb} DATA {{ GRAPH {graph_of(context)} {{ {' . '.join(some)} }} }}")

    def _enqueue(self, request: str) -> None:
        with self._lock:
            if not self._lost:  # else everything will be written again
                self._requests.append(request)

    def _send(self) -> None:
        """Sends the queued requests in order.

        :raises SkirosError: sending failed; all contexts must be written again.
        """
        with self._sending:
            while True:
                with self._lock:
                    if self._lost:
                        raise Refused(f"SPARQL endpoint {without_password(self._url)} has just been lost; try again")
                    count = _fitting(self._requests)
                    batch, self._requests = self._requests[:count], self._requests[count:]
                    self._claimed = self._claimed or not batch
                if not batch:
                    return
                try:
                    self._connection.send(" ;\n".join(batch))
                except SkirosError:
                    with self._lock:
                        self._lost, self._requests = True, []
                    raise

    def _ask(
        self, query: str, graph: URIRef | None = None, namespaces: Mapping[str, str] | None = None
    ) -> list[tuple[Any, ...]]:
        """Runs a query. Returns its rows in the terms of rdflib.

        :param graph: the graph to query; None: all.
        """
        result = self._connection.query(query, initNs=namespaces, queryGraph=graph)
        if result.type == "ASK":
            return [(Literal(result.askAnswer),)]
        rows: list[tuple[Any, ...]] = [tuple(row) for row in result]  # type: ignore[arg-type]  # no bools here
        check_count(rows, self._rows, query)
        return rows

    def _check_graphs(self) -> None:
        """Checks that the endpoint supports graphs as required.

        :raises Refused: it does not.
        """
        mark, where = f'ASK {{ {_SESSION} {_VALUE} "{self._name}" }}', f"SPARQL endpoint {without_password(self._url)}"
        heeded = [bool(self._ask(mark, URIRef(graph))[0][0]) for graph in (_SESSION[1:-1], "urn:skiros:none")]
        if heeded != [True, False]:
            raise Refused(f"{where} does not heed default-graph-uri, by which a context is asked (SPARQL 1.1 Protocol)")
        if not self._ask(mark)[0][0]:
            raise Refused(
                f"{where}: its default graph does not include its named graphs, so the contexts cannot be asked with "
                "the rest; set it so (Fuseki: tdb2:unionDefaultGraph true; Oxigraph: --union-default-graph)"
            )


def _chunks(texts: Iterable[str]) -> Iterator[list[str]]:
    remaining = iter(texts)
    while some := list(islice(remaining, _CHUNK)):
        yield some


def _fitting(requests: Sequence[str]) -> int:
    """The number of requests to join into the next one; at least one."""
    size = count = 0
    for request in requests:
        size += len(request)
        if count and size > _LARGE:
            break
        count += 1
    return count


def _written(triple: ox.Triple) -> str:
    text = str(triple)
    if "_:" not in text:
        return text
    terms = (triple.subject, triple.predicate, triple.object)
    return " ".join(f"<{_BLANK}{t.value}>" if isinstance(t, ox.BlankNode) else str(t) for t in terms)


def _read(term: Any) -> Any:
    """Converts a term of rdflib to the store's, and restores blank nodes."""
    found = store_term(term)
    if isinstance(found, ox.NamedNode) and found.value.startswith(_BLANK):
        return ox.BlankNode(found.value.removeprefix(_BLANK))
    return found
