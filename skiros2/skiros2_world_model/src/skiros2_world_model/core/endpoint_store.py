"""A triple store in a SPARQL 1.1 endpoint, which may hold other graphs, too."""

from __future__ import annotations

import base64
import http.client
import threading
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice

import pyoxigraph as ox

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError, TimedOut, WrongValue
from skiros2_common.core.operations import ONTOLOGY
from skiros2_world_model.core.prefixes import OWL, RDF, RDFS
from skiros2_world_model.core.query_store import WorkerStore
from skiros2_world_model.core.triple_store import (
    QUERY_ROWS,
    QUERY_SECONDS,
    TRIPLE,
    Answer,
    Term,
    check_count,
    graph_of,
)

_ANSWERS = "application/sparql-results+json, application/n-triples;q=0.9, text/turtle;q=0.8"
_FORM = "application/x-www-form-urlencoded"
_UPDATE = "application/sparql-update; charset=UTF-8"
#: The maximum size of an answer.
_MOST_BYTES = 1 << 28
#: The maximum length of a quoted error message of the server (bytes).
_MAX_QUOTE = 500

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


class EndpointConnection:
    """HTTP requests to an endpoint, with a timeout and the server's error messages. Thread-safe.

    :param query_url, update_url: the endpoint; `http://user:password@host/...` logs in.
    :param seconds: the timeout of an answer (s).
    """

    def __init__(self, query_url: str, update_url: str, seconds: float) -> None:
        self._query_url, self._update_url = query_url, update_url
        self._seconds = seconds

    def send(self, update: str) -> None:
        """Sends an update.

        :raises WrongValue: the server cannot parse it.
        :raises Refused: the server cannot be reached, or refuses it.
        :raises TimedOut: the server does not answer in time.
        """
        self._post(self._update_url, update, _UPDATE)

    def ask(self, query: str, graph: str = "") -> Answer:
        """Runs a query.

        :param graph: the IRI of the graph to query; "": all.
        :raises SkirosError: as for `send`.
        """
        fields = {"query": query, "default-graph-uri": graph} if graph else {"query": query}
        content, kind = self._post(self._query_url, urllib.parse.urlencode(fields), _FORM)
        try:
            if (rdf := ox.RdfFormat.from_media_type(kind)) is not None and kind != "application/json":
                return Answer(TRIPLE, [tuple(quad.triple) for quad in ox.parse(content, rdf)])
            results = ox.QueryResultsFormat.from_media_type(kind) or ox.QueryResultsFormat.JSON
            answer = ox.parse_query_results(content, results)
            if isinstance(answer, ox.QueryBoolean):
                return Answer([], [(ox.Literal(bool(answer)),)])
            return Answer([name.value for name in answer.variables], [tuple(row) for row in answer])
        except (SyntaxError, ValueError, OSError) as error:
            url = without_password(self._query_url)
            raise Refused(f"SPARQL endpoint {url} did not answer with a query result ({kind}): {error}") from None

    def _post(self, url: str, text: str, kind: str) -> tuple[bytes, str]:
        """Sends a POST request. Returns the answer and its media type."""
        plain, login = _parted(url)
        headers = {"Content-Type": kind, "Accept": _ANSWERS, **login}
        where = f"SPARQL endpoint {without_password(url)}"
        try:
            request = urllib.request.Request(plain, text.encode(), headers)
            with urllib.request.urlopen(request, timeout=self._seconds) as response:
                content = response.read(_MOST_BYTES + 1)
            if len(content) > _MOST_BYTES:
                raise WrongValue(f"{where}: the answer is larger than {_MOST_BYTES} bytes; expected a LIMIT")
            return content, response.headers.get_content_type()
        except urllib.error.HTTPError as error:
            raise _refusal(where, error) from None
        except TimeoutError:
            raise TimedOut(f"{where}: no answer within {self._seconds:g} s") from None
        except WrongValue:
            raise
        except (OSError, http.client.HTTPException, ValueError) as error:
            reason = getattr(error, "reason", None) or error
            if isinstance(reason, TimeoutError):
                raise TimedOut(f"{where}: no answer within {self._seconds:g} s") from None
            raise Refused(f"{where} cannot be reached: {reason}") from None


def without_password(url: str) -> str:
    """A URL without user and password."""
    return _parted(url)[0]


def _refusal(where: str, error: urllib.error.HTTPError) -> SkirosError:
    with error:
        message = error.read(_MAX_QUOTE).decode(errors="replace").strip()
        text = f"{where} answered {error.code} {error.reason}: {message}"
    return WrongValue(text) if error.code == http.client.BAD_REQUEST else Refused(text)


def _parted(url: str) -> tuple[str, dict[str, str]]:
    """A URL without user and password, and the HTTP header with them."""
    parts = urllib.parse.urlsplit(url)
    user, at, host = parts.netloc.rpartition("@")
    login = base64.b64encode(urllib.parse.unquote(user).encode()).decode()
    return parts._replace(netloc=host).geturl(), {"Authorization": f"Basic {login}"} if at else {}


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
        self._ontologies = WorkerStore(seconds, rows)
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
            self._knowledge = [ox.Triple(*row) for row in self._ask(_KNOWLEDGE).rows]
        except SkirosError as error:
            raise ConfigurationError(str(error)) from None

    def prepare(self) -> None:
        """Checks that the endpoint answers and still has our graphs; otherwise starts again."""
        with self._sending:
            found = self._ask(f"SELECT ?name {{ GRAPH {_SESSION} {{ {_SESSION} {_VALUE} ?name }} }}")
            names = {row[0].value for row in found.rows}
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
        self.update(context, (), triples)

    def update(self, context: str, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> None:
        removed, added = list(removed), list(added)
        with self._lock:
            if context == ONTOLOGY:
                self._ontologies.update(context, removed, added)
            self._write("DELETE", context, removed)
            self._write("INSERT", context, added)

    def rewrite(
        self,
        context: str,
        subjects: Iterable[ox.NamedNode],
        removed: Iterable[ox.Triple],
        added: Iterable[ox.Triple],
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

    def sync(self) -> None:
        """A query sends the changes before it."""

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> Answer:
        if context == ONTOLOGY:
            self._ontologies.sync()
            return self._ontologies.query(query, context, namespaces)
        self._ontologies.check(query, namespaces)
        self._send()
        declared = "".join(f"PREFIX {prefix}: <{iri}>\n" for prefix, iri in namespaces.items())
        answer = self._ask(declared + query, graph_of(context).value if context else "")
        return Answer(answer.names, [tuple(map(_read, row)) for row in answer.rows])

    def _restart(self) -> None:
        """Drops all graphs of world models; the contexts must be written again."""
        graphs = self._ask(f"SELECT ?graph {{ GRAPH {_SESSION} {{ {_SESSION} {_MEMBER} ?graph }} }}")
        with self._lock:
            self._lost = self._claimed = False
            self.generation += 1
            self._requests = [f"DROP SILENT GRAPH {row[0]}" for row in graphs.rows]
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

    def _ask(self, query: str, graph: str = "") -> Answer:
        """Runs a query on a graph; "": on all."""
        answer = self._connection.ask(query, graph)
        check_count(answer.rows, self._rows, query)
        return answer

    def _is_true(self, query: str, graph: str = "") -> bool:
        return bool(self._ask(query, graph).rows[0][0].value == "true")

    def _check_graphs(self) -> None:
        """Checks that the endpoint supports graphs as required.

        :raises Refused: it does not.
        """
        mark, where = f'ASK {{ {_SESSION} {_VALUE} "{self._name}" }}', f"SPARQL endpoint {without_password(self._url)}"
        heeded = [self._is_true(mark, graph) for graph in (_SESSION[1:-1], "urn:skiros:none")]
        if heeded != [True, False]:
            raise Refused(f"{where} ignores default-graph-uri, by which a context is asked (SPARQL 1.1 Protocol)")
        if not self._is_true(mark):
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


def _read(term: Term) -> Term:
    """Restores blank nodes."""
    if isinstance(term, ox.NamedNode) and term.value.startswith(_BLANK):
        return ox.BlankNode(term.value.removeprefix(_BLANK))
    return term
