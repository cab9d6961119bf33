"""Runs planning engines in processes that can be killed at any time.

Loading unified-planning takes a second, so a process loads it once and forks a child for each run (see
`engine_worker`). The standard library's fork server is not used: it imports the program's main module again in each
child, and the scripts of nodes start the node when they are imported.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection
from pathlib import Path

from skiros2_common.core.errors import ConfigurationError
from skiros2_task.core.task import PlanningTask, PlanStep

#: The files of a run in its working folder.
DOMAIN_FILE, PROBLEM_FILE, PLAN_FILE, LOG_FILE = "domain.pddl", "p01.pddl", "plan.txt", "planner.log"

_CANCEL_PERIOD = 0.02  # s between two checks for cancellation
_GRACE_PERIOD = 2.0  # s after its time limit in which an engine may end by itself
_EXIT_TIMEOUT = 1.0  # s for the end of a process
_LOADING_TIMEOUT = 60.0  # s for loading unified-planning


class Outcome(Enum):
    """The outcome of a planner run."""

    SOLVED = "solved"
    IMPOSSIBLE = "proven impossible"
    TIMED_OUT = "timed out"
    CANCELLED = "cancelled"
    FAILED = "failed"


@dataclass(frozen=True)
class Limits:
    """Limits of a planner run.

    :param seconds: wall-clock time.
    :param memory_mb: address space per process (MiB), by default half of the machine's memory; None: unlimited.
    """

    seconds: float = 60.0
    memory_mb: int | None = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") >> 21


@dataclass(frozen=True)
class EngineCall:
    """An engine of unified-planning.

    :param name: its name in unified-planning, or `module:Class` of an unregistered engine.
    :param options: of the engine.
    """

    name: str
    options: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Search:
    """A search configuration of Fast Downward.

    :param name: in logs.
    :param expression: the argument of `--search`.
    """

    name: str
    expression: str


@dataclass(frozen=True)
class SearchPortfolio:
    """Searches that run at the same time, as many as there are free cores; the others wait in order.

    :param searches: the most promising first.
    :param grace_share: the grace period for further plans after the first one, as a share of the time until then, at
        least `fast_downward.MIN_GRACE_PERIOD`; None: until all searches have ended.
    :param goal_action: compile the goal to an action, for searches without support for disjunctive goals.
    """

    searches: tuple[Search, ...]
    grace_share: float | None = None
    goal_action: bool = False


@dataclass(frozen=True)
class Job:
    """A task to solve, and how to solve it."""

    task: PlanningTask
    work: EngineCall | SearchPortfolio
    limits: Limits


@dataclass(frozen=True)
class ListEngines:
    """A request for the installed engines. The answer's reason has a line for each."""


@dataclass(frozen=True)
class FoundPlan:
    """A plan of an engine; not validated.

    :param by: the name of the engine or search.
    :param seconds: from the start of the job until the plan was found.
    :param text: the plan in PDDL names, a line per step, as validators read it.
    """

    by: str
    steps: tuple[PlanStep, ...]
    seconds: float = 0.0
    text: str = ""


@dataclass(frozen=True)
class WorkerAnswer:
    """The result of a job.

    :param plans: if solved, in the order in which they were found.
    """

    outcome: Outcome
    plans: tuple[FoundPlan, ...] = ()
    reason: str = ""


TIMED_OUT = WorkerAnswer(Outcome.TIMED_OUT, reason="the planner found no plan within the time limit")
_CANCELLED = WorkerAnswer(Outcome.CANCELLED, reason="cancelled")


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
    """A process with unified-planning loaded, and a child for each run. Thread-safe."""

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
        """Returns the answer to a job; None if the process ended without an answer. The child has ended afterwards.

        :raises _NotStarted: no child has started the job.
        """
        with self._connect(folder) as connection:
            pid = _receive(connection, _LOADING_TIMEOUT, cancelled)
            if isinstance(pid, WorkerAnswer):  # cancelled, or timed out
                return pid
            if not isinstance(pid, int):
                raise _NotStarted
            with contextlib.suppress(OSError):  # if the child has died, there will be no answer
                connection.send(job)
            seconds = job.limits.seconds if isinstance(job, Job) else _LOADING_TIMEOUT
            answer = _receive(connection, seconds + _GRACE_PERIOD, cancelled)
            if answer is _CANCELLED or answer is TIMED_OUT:
                kill_tree(pid)  # still the same process, as its connection is open
            else:
                _wait_for_end(connection)
            return answer if isinstance(answer, WorkerAnswer) else None

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

    def _connect(self, folder: Path) -> Connection:
        """Returns a connection to a new child. Restarts the process if it has died."""
        with self._lock:
            ours, theirs = _pair(socket.SOCK_STREAM)
            with ours, theirs:
                try:
                    if self._process.poll() is not None:
                        raise BrokenPipeError
                    self._request(folder, theirs)
                except OSError:  # the process has died
                    self._stop()
                    self._process, self._requests = _start()
                    self._request(folder, theirs)
                return Connection(ours.detach())

    def _request(self, folder: Path, connection: socket.socket) -> None:
        socket.send_fds(self._requests, [os.fsencode(folder)], [connection.fileno()])

    def _stop(self) -> None:
        self._requests.close()
        kill_tree(self._process.pid)
        self._process.wait()


class _NotStarted(Exception):
    """No child has started the job."""


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


def _receive(connection: Connection, seconds: float, cancelled: threading.Event) -> object:
    """Returns the next object of a child; None if the child has ended; `_CANCELLED` or `TIMED_OUT`."""
    deadline = time.monotonic() + seconds
    try:
        while not connection.poll(_CANCEL_PERIOD):
            if cancelled.is_set():
                return _CANCELLED
            if time.monotonic() > deadline:
                return TIMED_OUT
        found: object = connection.recv()
        return found
    except (EOFError, OSError):
        return None


def _wait_for_end(connection: Connection) -> None:
    """Waits until a child has ended."""
    with contextlib.suppress(EOFError, OSError):
        connection.recv_bytes()


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


# -- process trees (Linux) ---------------------------------------------------------------------------------------------


def kill_tree(pid: int, itself: bool = True) -> None:
    """Kills a process with all its descendants. Processes that have ended are ignored.

    :param itself: whether to kill the process too. If not, it must not start processes meanwhile.
    """
    # All are stopped before the first is killed, so that none starts another one unseen.
    stopped = [pid] if itself else []
    for child in stopped:
        _signal(child, signal.SIGSTOP)
    while new := [child for child in descendants(pid) if child not in stopped]:
        for child in new:
            _signal(child, signal.SIGSTOP)
        stopped += new
    for child in stopped:
        _signal(child, signal.SIGKILL)


def descendants(pid: int) -> list[int]:
    """Returns the descendants of a process in all sessions, parents first."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError):
                # The name in parentheses may contain any character; the parent is the second field after it.
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                children.setdefault(int(fields[1]), []).append(int(entry.name))
    found: list[int] = []
    waiting = [pid]
    while waiting:
        new = children.get(waiting.pop(), [])
        found += new
        waiting += new
    return found


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)
