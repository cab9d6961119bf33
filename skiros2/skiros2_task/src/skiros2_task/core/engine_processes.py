"""Runs planning engines in processes that can be killed at any time."""

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

_CANCEL_PERIOD = 0.02  # s between two checks for cancellation
_GRACE_PERIOD = 2.0  # s after its time limit in which an engine may end by itself
_EXIT_TIMEOUT = 1.0  # s for the end of a process
_LOADING_TIMEOUT = 60.0  # s for loading unified-planning


@dataclass(frozen=True)
class Run:
    """The result of a run.

    :param log: the engine's output.
    :param files: (file name, text) pairs: the PDDL of domain and problem, if written.
    """

    answer: WorkerAnswer
    log: str = ""
    files: tuple[tuple[str, str], ...] = ()


class EngineProcesses:
    """A process with unified-planning loaded, and a child for each run (see `engine_worker`). Thread-safe."""

    def __init__(self) -> None:
        """Starts the process, which loads in the background."""
        self._lock = threading.Lock()
        self._closed = False
        self._process, self._requests = _start()

    def run(self, job: Job | ListEngines, cancelled: threading.Event) -> Run:
        """Blocks until the job has ended, its time limit has passed or `cancelled` is set."""
        folder = Path(tempfile.mkdtemp(prefix="skiros-plan-"))
        try:
            try:
                answer = self._answer(folder, job, cancelled)
            except _NotStarted:
                answer = self._retry(folder, job, cancelled)
            log = _text(folder / LOG_FILE)
            if answer is None:
                last = (log.strip().splitlines() or ["no output"])[-1]
                answer = WorkerAnswer(Outcome.FAILED, reason=f"the planner's process ended without an answer: {last}")
            names = (name for name in (DOMAIN_FILE, PROBLEM_FILE) if (folder / name).exists())
            return Run(answer, log, tuple((name, _text(folder / name)) for name in names))
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def engines(self) -> tuple[str, ...]:
        """Returns the names of the installed planning engines of unified-planning.

        :raises ConfigurationError: they cannot be listed.
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

    def _retry(self, folder: Path, job: Job | ListEngines, cancelled: threading.Event) -> WorkerAnswer | None:
        """Runs a job in a new process if the old one has died; otherwise returns None."""
        with self._lock:
            try:
                self._process.wait(_EXIT_TIMEOUT)
            except subprocess.TimeoutExpired:
                return None  # it is alive and may have other runs
            if self._closed:
                return None
        try:
            return self._answer(folder, job, cancelled)
        except _NotStarted:
            return None

    def _connect(self, folder: Path) -> socket.socket:
        """Returns a connection to a new child process. Restarts the process if it has died."""
        with self._lock:
            ours, theirs = _pair(socket.SOCK_STREAM)
            try:
                try:
                    if self._process.poll() is not None:
                        raise BrokenPipeError
                    self._request(folder, theirs)
                except OSError:  # the process has died
                    self._stop()
                    self._process, self._requests = _start()
                    self._request(folder, theirs)
            except OSError:
                ours.close()
                raise
            finally:
                theirs.close()
            return ours

    def _request(self, folder: Path, connection: socket.socket) -> None:
        socket.send_fds(self._requests, [os.fsencode(folder)], [connection.fileno()])

    def _stop(self) -> None:
        self._requests.close()
        kill_tree(self._process.pid)
        self._process.wait()


def _start() -> tuple[subprocess.Popen[bytes], socket.socket]:
    # Message-oriented, so that a request and its socket arrive together.
    ours, theirs = _pair(socket.SOCK_SEQPACKET)
    with theirs:
        folders = [folder for folder in sys.path if folder and Path(folder).exists()]
        process = subprocess.Popen(
            [sys.executable, "-m", "skiros2_task.core.engine_worker", str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(folders)},
            pass_fds=[theirs.fileno()],
            start_new_session=True,  # not interrupted by Ctrl-C; the node ends it
        )
    return process, ours


def _pair(kind: socket.SocketKind) -> tuple[socket.socket, socket.socket]:
    """Returns two connected blocking sockets, regardless of the default timeout, which rospy sets."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, kind)
    ours.setblocking(True)
    theirs.setblocking(True)
    return ours, theirs


def _answer(connection: socket.socket, job: Job | ListEngines, cancelled: threading.Event) -> WorkerAnswer | None:
    """Returns the answer to a job; None if the process ended without an answer. The process has ended afterwards.

    :raises _NotStarted: no process has started the job.
    """
    reader = _Reader(connection, cancelled)
    try:
        pid = reader.next(_LOADING_TIMEOUT)
        if not isinstance(pid, int):
            raise _NotStarted
        with contextlib.suppress(OSError):  # if the process has died, there will be no answer
            connection.sendall(pickle.dumps(job))
        try:
            answer = reader.next((job.limits.seconds if isinstance(job, Job) else _LOADING_TIMEOUT) + _GRACE_PERIOD)
        except _Aborted:
            kill_tree(pid)  # still the same process, as its connection is open
            raise
        reader.wait_for_end()
        return answer if isinstance(answer, WorkerAnswer) else None
    except _Aborted as reason:
        return reason.answer


class _NotStarted(Exception):
    """No process has started the job."""


class _Aborted(Exception):
    """The run was cancelled or has timed out."""

    def __init__(self, answer: WorkerAnswer) -> None:
        super().__init__(answer.reason)
        self.answer = answer


class _Reader:
    """Reads pickled objects from a connection."""

    def __init__(self, connection: socket.socket, cancelled: threading.Event) -> None:
        self._connection = connection
        self._cancelled = cancelled
        self._received = b""

    def next(self, seconds: float) -> object:
        """Returns the next object, or None at the end of the stream.

        :raises _Aborted: the run was cancelled, or `seconds` have passed.
        """
        deadline = time.monotonic() + seconds
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
                data = self._receive()
                if not data:
                    return None
                self._received += data
            elif self._cancelled.is_set():
                raise _Aborted(WorkerAnswer(Outcome.CANCELLED, reason="cancelled"))
            elif time.monotonic() > deadline:
                raise _Aborted(TIMED_OUT)

    def wait_for_end(self) -> None:
        """Waits until the process has ended."""
        while self._receive():
            pass

    def _receive(self) -> bytes:
        """Returns the next bytes; b"" if the process has ended."""
        try:
            return self._connection.recv(1 << 16)
        except OSError:
            return b""


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
