"""The triple store whose queries run in processes of their own, see `query_worker.py`.

A *holder* process has the graphs. Queries are answered by *workers*, which are forked from it: each has a copy of the
graphs without copying memory, and serves queries until one of them ends it. A replacement takes milliseconds.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, islice
from typing import Any

import pyoxigraph as ox

from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_common.core.operations import ONTOLOGY
from skiros2_world_model.core import query_worker as wire
from skiros2_world_model.core.triple_store import (
    QUERY_BYTES,
    QUERY_MEMORY,
    QUERY_ROWS,
    QUERY_SECONDS,
    Answer,
    Graphs,
    QueryError,
    QueryNotAllowed,
    QueryTooLarge,
    Row,
    StoreLost,
    graph_of,
)

#: The maximum numbers of workers, and of those kept for the next query.
_MOST, _IDLE = 8, 2
#: A worker with more changes to catch up with (bytes) is replaced.
_BEHIND = 1 << 20
#: More changes than this are not kept: everything is written again before the next query.
_UNSENT = 1_000
#: The number of triples in one message.
_CHUNK = 5_000
#: A process that has not answered for this time (s) is killed: beyond the limit of a query, and for any other request.
_GRACE, _PATIENCE = 1.0, 30.0
#: A query that has run for this time (s) continues with a low priority.
_LONG, _NICENESS = 0.5, 10
#: The maximum length of a query (characters).
_TEXT = 1_000_000

_Message = tuple[bytes, bytes]


class _Process:
    """The server's end of a root, holder or worker. Equal only to itself."""

    def __init__(self, connection: socket.socket, pid: int, parent: _Process | None = None) -> None:
        self.connection, self.pid, self.parent = connection, pid, parent
        self.behind: list[_Message] = []  # changes that a worker was not sent yet
        self.size = 0  # of these, since the last query
        connection.settimeout(_PATIENCE)

    def fork(self) -> _Process:
        """Forks a process.

        :raises OSError, EOFError: this process has ended.
        """
        ours, theirs = _connected()
        with theirs:
            wire.send(self.connection, wire.FORK, passed=theirs)
        return _Process(ours, self._number(), self)

    def wait(self, child: int) -> int:
        """The status of a child that has ended: the number of a signal is negative."""
        wire.send(self.connection, wire.WAIT, b"%d" % child)
        return self._number()

    def is_alive(self) -> bool:
        """Whether the process has not ended. There must be no message to receive."""
        return self.is_silent(0)

    def is_silent(self, seconds: float) -> bool:
        """Waits for a message, or the end of the process. Returns True when there is none in that time."""
        poll = select.poll()
        poll.register(self.connection, select.POLLIN)
        return not poll.poll(seconds * 1000)

    def _number(self) -> int:
        return int(wire.receive(self.connection)[1])


class _Root:
    """The root of this process: started when it is first needed. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: _Process | None = None
        self._owner = 0

    def holder(self) -> _Process:
        """Forks a new, empty holder.

        :raises Refused: that is not possible.
        """
        with self._lock:
            for _ in range(2):  # the root that is there may have been killed
                try:
                    if self._process is None or self._owner != os.getpid():
                        self._process, self._owner = _start(), os.getpid()
                    return self._process.fork()
                except (OSError, EOFError) as error:
                    self._process, reason = None, error
        raise Refused(f"SPARQL: no process for queries can be started: {reason!r}")


def _connected() -> tuple[socket.socket, socket.socket]:
    """Two connected sockets. The second one, which another process gets, blocks, also where this process has a default
    timeout, as rospy sets it."""
    ours, theirs = socket.socketpair()
    theirs.setblocking(True)
    return ours, theirs


def _start() -> _Process:
    ours, theirs = _connected()
    with theirs:
        number = theirs.fileno()
        process = subprocess.Popen(
            [sys.executable, "-m", wire.__name__, str(number)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[number],
        )
    return _Process(ours, process.pid)


_root = _Root()


class WorkerStore:
    """Named graphs in a process of their own, with queries in further ones. See `TripleStore`.

    No process is started before the first query. The ontologies are also kept in memory here.

    :param seconds, rows, size, memory: the limits of a query: time, number and bytes of the rows, bytes of memory.
    """

    def __init__(
        self,
        seconds: float = QUERY_SECONDS,
        rows: int = QUERY_ROWS,
        size: int = QUERY_BYTES,
        memory: int = QUERY_MEMORY,
    ) -> None:
        self._limits = {"seconds": seconds, "rows": rows, "bytes": size, "memory": memory}
        self._seconds, self._memory = seconds, memory
        self._ontologies = Graphs()
        self._free = threading.BoundedSemaphore(_MOST)
        self._syncing = threading.Lock()  # held while a change is sent: until its end, no worker is forked
        self._control = threading.RLock()  # guards the processes
        self._holder: _Process | None = None
        self._idle: list[_Process] = []
        self._busy: set[_Process] = set()
        self._lock = threading.Lock()  # guards the fields below; never held while waiting
        self._written: deque[Iterable[_Message]] = deque()  # changes that were not sent yet
        self.generation = 0

    def prepare(self) -> None:
        """Starts the holder; starts another one if it has ended."""
        with self._control:
            if self._holder is not None and not self._holder.is_alive():
                self._lose()
            self._running()

    def knowledge(self) -> list[ox.Triple]:
        return []

    def replace(self, context: str, triples: Iterable[ox.Triple]) -> None:
        if context == ONTOLOGY:
            triples = list(triples)
            self._ontologies.clear(context)
            self._ontologies.update(context, (), triples)
        self._write([(wire.CLEAR, context.encode())], _quads(wire.ADD, context, triples))

    def extend(self, context: str, triples: Iterable[ox.Triple]) -> None:
        self.update(context, (), triples)

    def update(self, context: str, removed: Iterable[ox.Triple], added: Iterable[ox.Triple]) -> None:
        if context == ONTOLOGY:
            removed, added = list(removed), list(added)
            self._ontologies.update(context, removed, added)
        self._write(_quads(wire.REMOVE, context, removed), _quads(wire.ADD, context, added))

    def rewrite(
        self,
        context: str,
        subjects: Iterable[ox.NamedNode],
        removed: Iterable[ox.Triple],
        added: Iterable[ox.Triple],
    ) -> None:
        def forget() -> Iterator[_Message]:
            iris = (subject.value for subject in subjects)
            while some := list(islice(iris, _CHUNK)):
                yield wire.FORGET, json.dumps([context, some]).encode()

        self._write(forget(), _quads(wire.REMOVE, context, removed), _quads(wire.ADD, context, added))

    def triples(self, context: str) -> list[ox.Triple]:
        return self._ontologies.triples(context)

    def has(self, context: str, triple: ox.Triple) -> bool:
        return self._ontologies.has(context, triple)

    def sync(self) -> None:
        with self._syncing:
            while (change := self._next()) is not None:
                done = False
                try:
                    for message in change:
                        self._send(*message)
                    done = True
                except (OSError, EOFError) as error:
                    raise StoreLost(f"SPARQL: the process with the graphs has ended: {error!r}") from None
                finally:
                    if not done:  # the holder has a part of the change
                        self._lose()

    def query(self, query: str, context: str, namespaces: Mapping[str, str]) -> Answer:
        return self._run(query, context, namespaces, False)

    def check(self, query: str, namespaces: Mapping[str, str]) -> None:
        """Checks that a text is a SPARQL query, without answering it.

        :raises SkirosError: as for `query`.
        """
        self._run(query, "", namespaces, True)

    # -- changes ---------------------------------------------------------------------------------------------------

    def _write(self, *messages: Iterable[_Message]) -> None:
        with self._lock:
            self._written.append(chain(*messages))
            if len(self._written) > _UNSENT:
                self._start_again()

    def _next(self) -> Iterable[_Message] | None:
        with self._lock:
            return self._written.popleft() if self._written else None

    def _send(self, kind: bytes, content: bytes) -> None:
        """Sends a part of a change to the holder, and keeps it for the workers."""
        with self._control:
            wire.send(self._running().connection, kind, content)
            for worker in [*self._idle, *self._busy]:
                worker.size += len(content)
                worker.behind = [*worker.behind, (kind, content)] if worker.size <= _BEHIND else []

    def _lose(self) -> None:
        """Forgets the processes; the contexts must be written again."""
        with self._control:
            with self._lock:
                self._start_again()
            for process in [self._holder, *self._idle]:
                if process is not None:
                    process.connection.close()
            self._holder, self._idle = None, []
            self._busy.clear()

    def _start_again(self) -> None:
        self.generation += 1
        self._written.clear()
        ontologies = _quads(wire.ADD, ONTOLOGY, self._ontologies.triples(ONTOLOGY))
        self._written.append(chain([(wire.CLEAR, ONTOLOGY.encode())], ontologies))

    def _running(self) -> _Process:
        """The holder, which is started if there is none."""
        if self._holder is None:
            self._holder = _root.holder()
        return self._holder

    # -- queries ---------------------------------------------------------------------------------------------------

    def _run(self, query: str, context: str, namespaces: Mapping[str, str], only_checks: bool) -> Answer:
        request = {"query": query, "context": context, "namespaces": dict(namespaces), "only_checks": only_checks}
        if len(query) > _TEXT:
            raise QueryTooLarge(f"is longer than {_TEXT} characters", query[:100] + "...")
        if not self._free.acquire(timeout=self._seconds):
            raise Refused(f"SPARQL: {_MOST} other queries are running; try again")
        try:
            worker = self._take()
            started, status, keeps = time.monotonic(), None, False
            try:
                found, keeps = self._asked(worker, json.dumps(request | self._limits).encode(), query)
            except (OSError, EOFError):
                found = None
            finally:
                status = self._give_back(worker, keeps)
        finally:
            self._free.release()
        if found is None:
            raise self._ended(status, time.monotonic() - started, query)
        if isinstance(found, SkirosError):
            raise found
        return found

    def _take(self) -> _Process:
        """A worker that has, or will be sent, all changes."""
        with self._syncing, self._control:
            while self._idle:
                worker = self._idle.pop()
                if worker.size <= _BEHIND and worker.is_alive():
                    break
                self._end(worker)
            else:
                try:
                    worker = self._running().fork()
                except (OSError, EOFError) as error:
                    self._lose()
                    raise StoreLost(f"SPARQL: the process with the graphs has ended: {error!r}") from None
            self._busy.add(worker)
            return worker

    def _asked(self, worker: _Process, request: bytes, query: str) -> tuple[Answer | SkirosError, bool]:
        """Sends a query. Returns the answer, or the reason why there is none, and whether the worker takes more.

        :raises OSError, EOFError: the worker has ended, or is too slow.
        """
        deadline = time.monotonic() + self._seconds + _GRACE
        with self._control:
            behind, worker.behind, worker.size = worker.behind, [], 0
        worker.connection.settimeout(_PATIENCE)
        worker.connection.sendall(b"".join(wire.packed(*message) for message in [*behind, (wire.QUERY, request)]))
        is_slow = worker.is_silent(min(_LONG, self._seconds))
        if is_slow:
            os.setpriority(os.PRIO_PROCESS, worker.pid, _NICENESS)
        rows: list[Row] = []
        while True:
            worker.connection.settimeout(max(deadline - time.monotonic(), 0.001))
            kind, content, _ = wire.receive(worker.connection)
            if kind == wire.ROWS:
                rows += _decoded(json.loads(content))
                continue
            found, ends = json.loads(content)
            keeps = not ends and not is_slow
            if kind == wire.FAILED:
                return _error(found, query), keeps
            return Answer(found[0], rows + _decoded(found[1])), keeps

    def _give_back(self, worker: _Process, keeps: bool) -> int | None:
        """Keeps a worker for the next query, or ends it and returns its status."""
        with self._control:
            if worker not in self._busy:  # the holder was lost meanwhile
                worker.connection.close()
                return None
            self._busy.remove(worker)
            if keeps and len(self._idle) < _IDLE:
                self._idle.append(worker)
                return None
            return self._end(worker)

    def _end(self, worker: _Process) -> int | None:
        """Kills a worker. Returns its status, None: unknown."""
        worker.connection.close()
        try:
            assert worker.parent is not None
            os.kill(worker.pid, signal.SIGKILL)  # without effect if it has ended; no other process has its number yet
            return worker.parent.wait(worker.pid)
        except (OSError, EOFError):
            self._lose()
            return None

    def _ended(self, status: int | None, seconds: float, query: str) -> SkirosError:
        """Why a worker has ended without an answer."""
        if status == -signal.SIGALRM or seconds >= self._seconds:
            return TimedOut(f"SPARQL query: {query}: ended after {self._seconds:g} s")
        if status == -signal.SIGABRT:
            return QueryTooLarge(f"needs more than {self._memory >> 20} MB", query)
        if status in (-signal.SIGSEGV, -signal.SIGBUS):
            return QueryError("it is nested too deeply", query)
        return StoreLost("SPARQL: the process that answered has ended")


def _decoded(rows: list[Any]) -> list[Row]:
    return [tuple(map(wire.decoded, row)) for row in rows]


def _error(failure: tuple[str, str], query: str) -> SkirosError:
    kind, reason = failure
    kinds = {wire.WRONG: QueryError, wire.NOT_ALLOWED: QueryNotAllowed, wire.TOO_LARGE: QueryTooLarge}
    return kinds[kind](reason, query)


def _quads(kind: bytes, context: str, triples: Iterable[ox.Triple]) -> Iterator[_Message]:
    graph = graph_of(context)
    quads = (ox.Quad(t.subject, t.predicate, t.object, graph) for t in triples)
    while some := list(islice(quads, _CHUNK)):
        yield kind, ox.serialize(some, format=ox.RdfFormat.N_QUADS) or b""
