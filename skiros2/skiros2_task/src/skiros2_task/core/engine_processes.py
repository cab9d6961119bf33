"""Runs of planning engines, each in a process of its own that can be ended at any time."""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from skiros2_common.core.errors import ConfigurationError
from skiros2_task.core.engine_worker import (
    DOMAIN_FILE,
    LOG_FILE,
    PROBLEM_FILE,
    TIMED_OUT,
    Job,
    ListEngines,
    WorkerAnswer,
)
from skiros2_task.core.planner import Outcome
from skiros2_task.core.processes import kill_tree

_CANCEL_PERIOD = 0.02  # s between two looks at whether a run is cancelled
_GRACE = 2.0  # s that an engine gets beyond its time to end by itself
_DYING_TIME = 1.0  # s that a process may take to be gone
_LOADING_TIME = 60.0  # s that loading unified-planning may take


@dataclass(frozen=True)
class Run:
    """What a run gave.

    :param log: what the engine printed.
    :param files: the PDDL of domain and problem, by file name, as far as it was written.
    """

    answer: WorkerAnswer
    log: str = ""
    files: tuple[tuple[str, str], ...] = ()


class EngineProcesses:
    """One process that has unified-planning loaded, and its children, one for each run (see `engine_worker`).

    Any thread may call it, several at once.
    """

    def __init__(self) -> None:
        """Starts the process, which loads in the background."""
        self._lock = threading.Lock()
        self._closed = False
        self._process, self._requests = _start()

    def run(self, job: Job | ListEngines, cancelled: threading.Event) -> Run:
        """Runs a job until there is an answer, its time is over or `cancelled` is set."""
        folder = Path(tempfile.mkdtemp(prefix="skiros-plan-"))
        try:
            try:
                answer = self._answer(folder, job, cancelled)
            except _NotTaken:
                answer = self._answer_of_new(folder, job, cancelled)
            log = _text(folder / LOG_FILE)
            if answer is None:
                last = (log.strip().splitlines() or ["without a word"])[-1]
                answer = WorkerAnswer(Outcome.FAILED, reason=f"the planner's process ended without an answer: {last}")
            names = (name for name in (DOMAIN_FILE, PROBLEM_FILE) if (folder / name).exists())
            return Run(answer, log, tuple((name, _text(folder / name)) for name in names))
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def engines(self) -> tuple[str, ...]:
        """The names of the engines of unified-planning that are installed and make plans.

        :raises ConfigurationError: unified-planning cannot be asked.
        """
        run = self.run(ListEngines(), threading.Event())
        if run.answer.outcome is not Outcome.SOLVED:
            raise ConfigurationError(f"the planning engines cannot be listed: {run.answer.reason}")
        return tuple(run.answer.reason.splitlines())

    def close(self) -> None:
        """Ends the process and its children."""
        with self._lock:
            self._closed = True
            self._stop()

    def _answer(self, folder: Path, job: Job | ListEngines, cancelled: threading.Event) -> WorkerAnswer | None:
        connection = self._connect(folder)
        try:
            return _answer(connection, job, cancelled)
        finally:
            connection.close()

    def _answer_of_new(self, folder: Path, job: Job | ListEngines, cancelled: threading.Event) -> WorkerAnswer | None:
        """The answer of a new process, when the one that was asked was dying; None otherwise."""
        with self._lock:
            try:
                self._process.wait(_DYING_TIME)
            except subprocess.TimeoutExpired:
                return None  # it lives, and other runs with it
            if self._closed:
                return None
        try:
            return self._answer(folder, job, cancelled)
        except _NotTaken:
            return None

    def _connect(self, folder: Path) -> socket.socket:
        """The connection to a new child process; the process is started anew if it has died."""
        with self._lock:
            ours, theirs = _pair(socket.SOCK_STREAM)
            try:
                try:
                    if self._process.poll() is not None:
                        raise BrokenPipeError
                    self._ask(folder, theirs)
                except OSError:  # it has died, or is dying
                    self._stop()
                    self._process, self._requests = _start()
                    self._ask(folder, theirs)
            except OSError:
                ours.close()
                raise
            finally:
                theirs.close()
            return ours

    def _ask(self, folder: Path, connection: socket.socket) -> None:
        socket.send_fds(self._requests, [os.fsencode(folder)], [connection.fileno()])

    def _stop(self) -> None:
        self._requests.close()
        kill_tree(self._process.pid)
        self._process.wait()


def _start() -> tuple[subprocess.Popen[bytes], socket.socket]:
    # A message each, so that a request and its socket come together.
    ours, theirs = _pair(socket.SOCK_SEQPACKET)
    with theirs:
        places = [place for place in sys.path if place and Path(place).exists()]
        process = subprocess.Popen(
            [sys.executable, "-m", "skiros2_task.core.engine_worker", str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
            pass_fds=[theirs.fileno()],
            start_new_session=True,  # a Ctrl-C in the terminal is for the node, which ends this one
        )
    return process, ours


def _pair(kind: socket.SocketKind) -> tuple[socket.socket, socket.socket]:
    """Two connected sockets that wait, whatever the process has set as the default (ROS does)."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, kind)
    ours.setblocking(True)
    theirs.setblocking(True)
    return ours, theirs


def _answer(connection: socket.socket, job: Job | ListEngines, cancelled: threading.Event) -> WorkerAnswer | None:
    """The answer to a job; None when the process ended without one. Nothing of the run is left afterwards.

    :raises _NotTaken: no process has begun with it.
    """
    reader = _Reader(connection, cancelled)
    try:
        pid = reader.next(_LOADING_TIME)
        if not isinstance(pid, int):
            raise _NotTaken
        with contextlib.suppress(OSError):  # it is gone: the missing answer tells
            connection.sendall(pickle.dumps(job))
        try:
            answer = reader.next((job.limits.seconds if isinstance(job, Job) else _LOADING_TIME) + _GRACE)
        except _Ended:
            kill_tree(pid)  # it is there: its connection is
            raise
        reader.wait_for_end()
        return answer if isinstance(answer, WorkerAnswer) else None
    except _Ended as reason:
        return reason.answer


class _NotTaken(Exception):
    """A job that no process has begun with."""


class _Ended(Exception):
    """A run is ended from this side."""

    def __init__(self, answer: WorkerAnswer) -> None:
        super().__init__(answer.reason)
        self.answer = answer


class _Reader:
    """Reads pickled objects from a connection as they come."""

    def __init__(self, connection: socket.socket, cancelled: threading.Event) -> None:
        self._connection = connection
        self._cancelled = cancelled
        self._received = b""

    def next(self, seconds: float) -> object:
        """The next object, or None at the end.

        :raises _Ended: the run is cancelled, or this takes too long.
        """
        ends = time.monotonic() + seconds
        while True:
            stream = io.BytesIO(self._received)
            try:
                found = pickle.load(stream)
            except (EOFError, pickle.UnpicklingError):
                pass
            else:
                self._received = stream.read()
                return found
            if select.select([self._connection], [], [], _CANCEL_PERIOD)[0]:
                part = self._part()
                if not part:
                    return None
                self._received += part
            elif self._cancelled.is_set():
                raise _Ended(WorkerAnswer(Outcome.CANCELLED, reason="cancelled"))
            elif time.monotonic() > ends:
                raise _Ended(TIMED_OUT)

    def wait_for_end(self) -> None:
        """Waits until the process has ended, as it does by itself after its answer."""
        while self._part():
            pass

    def _part(self) -> bytes:
        """What comes next; nothing when the process has ended."""
        try:
            return self._connection.recv(1 << 16)
        except OSError:
            return b""


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
