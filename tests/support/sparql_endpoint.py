"""A SPARQL 1.1 endpoint over HTTP for tests: pyoxigraph answers, as the Oxigraph server does.

What the SPARQL 1.1 Protocol says of queries and updates by POST, and `default-graph-uri`.
"""

from __future__ import annotations

import threading
import urllib.parse
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType

import pyoxigraph as ox


class SparqlEndpoint:
    """An endpoint on a free port of this machine; a context manager.

    :param union: whether its default graph is the union of all its graphs.
    :param heeds_graphs: whether it knows `default-graph-uri`.
    """

    def __init__(self, union: bool = True, heeds_graphs: bool = True) -> None:
        self.store = ox.Store()
        self.union = union
        self.heeds_graphs = heeds_graphs
        self.requests: list[str] = []  #: the updates that it was sent
        self.logins: set[str] = set()  #: the Authorization headers that came
        self.refuses: int | None = None  #: the status that it answers everything with, if so
        self.silent: threading.Event | None = None  #: it answers nothing before this is set
        self._port = 0
        self._server: ThreadingHTTPServer | None = None

    @property
    def url(self) -> str:
        return f"http://localhost:{self._port}/sparql"

    def start(self) -> None:
        """Starts it, at the port that it had before."""
        endpoint = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"])).decode()
                if endpoint.silent is not None:
                    endpoint.silent.wait()
                endpoint.logins.add(self.headers.get("Authorization", ""))
                status, kind, content = endpoint._answer(self.headers.get_content_type(), body)
                self.send_response(status)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, format: str, *args: object) -> None:
                """Tests tell what they want to know."""

        self._server = ThreadingHTTPServer(("localhost", self._port), Handler)
        self._server.daemon_threads = True
        self._port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def stop(self) -> None:
        """Ends it; what it holds stays for the next start."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    def __enter__(self) -> SparqlEndpoint:
        self.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.stop()

    def graph(self, context: str) -> set[str]:
        """The triples of a context, as it holds them."""
        graph = ox.NamedNode(f"urn:skiros:context:{context}")
        return {str(quad.triple) for quad in self.store.quads_for_pattern(None, None, None, graph)}

    def _answer(self, kind: str, body: str) -> tuple[int, str, bytes]:
        if self.refuses is not None:
            return self.refuses, "text/plain", b"not now"
        try:
            if kind == "application/sparql-update":
                self.requests.append(body)
                self.store.update(body)
                return 204, "text/plain", b""
            fields = urllib.parse.parse_qs(body)
            return self._query(fields["query"][0], fields.get("default-graph-uri", []))
        except (SyntaxError, ValueError, KeyError) as error:
            return 400, "text/plain", str(error).encode()

    def _query(self, query: str, graphs: list[str]) -> tuple[int, str, bytes]:
        if graphs and self.heeds_graphs:
            answer = self.store.query(query, default_graph=[ox.NamedNode(graph) for graph in graphs])
        else:
            answer = self.store.query(query, use_default_graph_as_union=self.union)
        if isinstance(answer, ox.QueryTriples):
            return 200, "application/n-triples", answer.serialize(format=ox.RdfFormat.N_TRIPLES)
        return 200, "application/sparql-results+json", answer.serialize(format=ox.QueryResultsFormat.JSON)
