"""The program of the processes that parse and evaluate SPARQL: named graphs, and queries with limits.

Three roles, all of this program, each forked from the one before it (see `query_store.py`):

- the *root* is empty, and forks a holder in milliseconds;
- a *holder* has the graphs of one store, and follows its changes; it gets no query;
- a *worker* begins as a copy of its holder. It cannot open files or sockets, so `SERVICE` reaches nothing; the system
  ends it at the deadline of a query, and when a query needs more memory than allowed.

Messages are a letter, a length and that number of bytes.
"""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import socket
import struct
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any

import pyoxigraph as ox

from skiros2_world_model.core.triple_store import CONTEXT_GRAPHS, TRIPLE, Graphs, graph_of

#: Requests: fork a child that serves the attached socket; return the status of a child that has ended; change a graph;
#: answer a query.
FORK, WAIT, CLEAR, FORGET, REMOVE, ADD, QUERY = b"F", b"W", b"C", b"S", b"R", b"A", b"Q"
#: Answers: the child's process id or status; some rows; the end of the rows; why there are none.
NUMBER, ROWS, END, FAILED = b"n", b"r", b"e", b"x"

#: Kinds of failures.
WRONG, NOT_ALLOWED, TOO_LARGE = "wrong", "not_allowed", "too_large"

_HEADER = struct.Struct("!cI")
_BATCH = 500
#: A worker that has grown by this number of bytes ends after its answer.
_GROWTH = 64 << 20
#: The maximum depth of quoted triples in an answer.
_DEPTH = 8


def send(connection: socket.socket, kind: bytes, content: bytes = b"", passed: socket.socket | None = None) -> None:
    """Sends a message, with a socket attached to it."""
    header = _HEADER.pack(kind, len(content))
    if passed is None:
        connection.sendall(header + content)
    else:
        socket.send_fds(connection, [header], [passed.fileno()])
        connection.sendall(content)


def receive(connection: socket.socket) -> tuple[bytes, bytes, int | None]:
    """Receives a message and the descriptor of an attached socket.

    :raises EOFError: the other side has closed the connection.
    """
    header, descriptors, _, _ = socket.recv_fds(connection, _HEADER.size, 1)
    kind, length = _HEADER.unpack(header + _exactly(connection, _HEADER.size - len(header)))
    return kind, _exactly(connection, length), descriptors[0] if descriptors else None


def _exactly(connection: socket.socket, length: int) -> bytes:
    parts = []
    while length:
        part = connection.recv(min(length, 1 << 20))
        if not part:
            raise EOFError
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


class QueryFailed(Exception):
    """A query has no answer: the kind of failure and its reason."""

    def __init__(self, kind: str, reason: str) -> None:
        super().__init__(kind, reason)
        self.kind, self.reason = kind, reason


# -- terms in JSON -----------------------------------------------------------------------------------------------


def _encoded(term: Any, depth: int = 0) -> list[Any] | None:
    if term is None:
        return None
    if isinstance(term, ox.NamedNode):
        return ["u", term.value]
    if isinstance(term, ox.Literal):
        return ["l", term.value, term.language or "", term.datatype.value]
    if isinstance(term, ox.BlankNode):
        return ["b", term.value]
    if depth == _DEPTH:
        raise QueryFailed(TOO_LARGE, f"has triples quoted more than {_DEPTH} deep")
    return ["t", *(_encoded(part, depth + 1) for part in (term.subject, term.predicate, term.object))]


def decoded(term: Sequence[Any] | None) -> Any:
    """The term that a worker has sent."""
    if term is None:
        return None
    kind, value, *more = term
    if kind == "u":
        return ox.NamedNode(value)
    if kind == "b":
        return ox.BlankNode(value)
    if kind == "t":
        return ox.Triple(*map(decoded, term[1:]))
    return ox.Literal(value, language=more[0]) if more[0] else ox.Literal(value, datatype=ox.NamedNode(more[1]))


# -- what a query may not contain ----------------------------------------------------------------------------------

#: Comments, IRIs, texts, variables and prefixed names, which may contain any word; then words and brackets.
_TOKEN = re.compile(
    r"""\#[^\n\r]*|(?P<iri><[^<>"{}|^`\\\x00-\x20]*>)
    |'{3}(?:[^\\]|\\.)*?'{3}|"{3}(?:[^\\]|\\.)*?"{3}|'(?:[^'\\\n\r]|\\.)*'|"(?:[^"\\\n\r]|\\.)*"
    |[?$@]\w+|(?P<name>[\w.-]*:(?:[\w.:%-]|\\.)*)|(?P<word>[A-Za-z]\w*)""",
    re.VERBOSE | re.DOTALL,
)


def check_words(query: str) -> None:
    """Checks that a query asks for nothing but the graphs of this world model.

    For the reason in words; a worker could not reach anything else.

    :raises QueryFailed: it uses SERVICE, LOAD or FROM.
    """
    after_from = False
    for token in _TOKEN.finditer(query):
        word = (token["word"] or "").upper()
        if word in ("SERVICE", "LOAD"):
            raise QueryFailed(NOT_ALLOWED, f"{word} is not allowed: a query reads this world model only")
        graph = token["iri"] or token["name"]
        if after_from and graph and not graph.startswith("<" + CONTEXT_GRAPHS):
            raise QueryFailed(NOT_ALLOWED, f"FROM {graph} is not allowed: name the context of the query instead")
        after_from = word == "FROM" or (after_from and word == "NAMED")


# -- the process -----------------------------------------------------------------------------------------------------


class _Process:
    """Serves one connection until its other side is closed."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._graphs = Graphs()
        self._level = 0  # root, holder, worker
        self._sizes = -1  # the descriptor of this process's sizes, once it is a worker
        self._size = 0

    def serve(self) -> None:
        while True:
            kind, content, passed = receive(self._connection)
            if kind == FORK and passed is not None:
                self._fork(socket.socket(fileno=passed))
            elif kind == WAIT:
                _, status = os.waitpid(int(content), 0)
                send(self._connection, NUMBER, b"%d" % os.waitstatus_to_exitcode(status))
            elif kind == QUERY:
                self._answer(json.loads(content))
            else:
                self._write(kind, content)

    def _write(self, kind: bytes, content: bytes) -> None:
        if kind == CLEAR:
            self._graphs.clear(content.decode())
        elif kind == FORGET:
            context, subjects = json.loads(content)
            self._graphs.forget(context, map(ox.NamedNode, subjects))
        elif kind == REMOVE:
            self._graphs.remove(ox.parse(content, ox.RdfFormat.N_QUADS))
        else:
            self._graphs.add(ox.parse(content, ox.RdfFormat.N_QUADS))

    def _fork(self, connection: socket.socket) -> None:
        # A server asks for the status of workers only.
        signal.signal(signal.SIGCHLD, signal.SIG_DFL if self._level else signal.SIG_IGN)
        child = os.fork()
        if child:
            connection.close()
            send(self._connection, NUMBER, b"%d" % child)
            return
        self._connection.close()
        self._connection = connection
        self._level += 1
        if self._level == 2:
            self._graphs.copies = False  # its memory is that of the holder
            self._sizes = os.open("/proc/self/statm", os.O_RDONLY)
            self._size = self._address_space()
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the server reports why a worker has ended
            resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def _address_space(self) -> int:
        return int(os.pread(self._sizes, 100, 0).split()[0]) * resource.getpagesize()

    def _answer(self, request: dict[str, Any]) -> None:
        unlimited = resource.RLIM_INFINITY
        limit = self._address_space() + request["memory"]
        resource.setrlimit(resource.RLIMIT_AS, (limit, unlimited))
        signal.setitimer(signal.ITIMER_REAL, request["seconds"])  # SIGALRM ends the process, whatever it does
        try:
            names, rows = self._send_rows(request)
            kind, content = END, b"[%s,%s]" % (json.dumps(names).encode(), rows)
        except QueryFailed as failed:
            kind, content = _failure(failed.kind, failed.reason)
        except MemoryError:
            kind, content = _failure(TOO_LARGE, f"needs more than {request['memory'] >> 20} MB")
        except OSError as error:  # of a connection that the check of words has not seen
            kind, content = _failure(NOT_ALLOWED, f"a query reads this world model only: {error}")
        except (SyntaxError, ValueError, RuntimeError) as error:
            kind, content = _failure(WRONG, str(error))
        signal.setitimer(signal.ITIMER_REAL, 0)
        resource.setrlimit(resource.RLIMIT_AS, (unlimited, unlimited))
        ends = self._graphs.is_worn or self._address_space() > self._size + _GROWTH
        send(self._connection, kind, b"[%s,%s]" % (content, b"true" if ends else b"false"))

    def _send_rows(self, request: dict[str, Any]) -> tuple[list[str], bytes]:
        """Sends the rows of an answer in batches; returns the names of the columns and the last rows."""
        check_words(request["query"])
        names, rows = _evaluate(self._graphs.store, request)
        count = size = 0
        while True:
            batch = [[_encoded(term) for term in row] for row in islice(rows, _BATCH)]
            count += len(batch)
            if count > request["rows"]:
                raise QueryFailed(TOO_LARGE, f"has more than {request['rows']} rows; expected a LIMIT")
            content = json.dumps(batch).encode()
            size += len(content)
            if size > request["bytes"]:
                raise QueryFailed(TOO_LARGE, f"has more than {request['bytes'] >> 20} MB of rows; expected a LIMIT")
            if len(batch) < _BATCH:
                return names, content
            send(self._connection, ROWS, content)


def _failure(kind: str, reason: str) -> tuple[bytes, bytes]:
    return FAILED, json.dumps([kind, reason]).encode()


def _evaluate(store: ox.Store, request: dict[str, Any]) -> tuple[list[str], Iterator[Iterable[Any]]]:
    context = request["context"]
    scope: dict[str, Any] = {"default_graph": graph_of(context)} if context else {"use_default_graph_as_union": True}
    if request["only_checks"]:
        store = ox.Store()
    found = store.query(request["query"], prefixes=request["namespaces"], **scope)
    if request["only_checks"]:
        return [], iter(())
    if isinstance(found, ox.QueryBoolean):
        return [], iter([[ox.Literal(bool(found))]])
    names = [name.value for name in found.variables] if isinstance(found, ox.QuerySolutions) else TRIPLE
    return names, iter(found)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal; the process ends with its connection
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        _Process(socket.socket(fileno=int(sys.argv[1]))).serve()
    except (EOFError, OSError):
        os._exit(0)
