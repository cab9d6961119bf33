"""Runs planning engines in processes that can be killed at any time.

Loading unified-planning takes a second, so a process loads it once and forks a child for each run (see
`engine_worker`). The standard library's fork server is not used: it imports the program's main module again in each
child, and the scripts of nodes start the node when they are imported.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace
from enum import Enum
from multiprocessing.connection import Connection
from pathlib import Path

from skiros2_common.core.processes import descendants
from skiros2_task.core.task import PlanningTask, PlanStep

#: The files of a run in its working folder.
DOMAIN_FILE, PROBLEM_FILE, PLAN_FILE, LOG_FILE = "domain.pddl", "p01.pddl", "plan.txt", "planner.log"

MIN_GRACE_PERIOD = 0.15  # s, see `SearchPortfolio`
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
        least `MIN_GRACE_PERIOD`; None: until all searches have ended.
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
class PlannerAnswer:
    """The result of a planner run.

    :param plans: the plans found, if solved, in the order in which they were found. They are not validated.
    :param reason: why there is no plan; "" if solved.
    :param log: the planner's output.
    :param files: (file name, text) pairs: the PDDL of domain and problem, if written.
    """

    outcome: Outcome
    plans: tuple[FoundPlan, ...] = ()
    reason: str = ""
    log: str = ""
    files: tuple[tuple[str, str], ...] = ()

    @property
    def plan(self) -> tuple[PlanStep, ...]:
        """The steps of the first plan found."""
        return self.plans[0].steps if self.plans else ()


TIMED_OUT = PlannerAnswer(Outcome.TIMED_OUT, reason="the planner found no plan within the time limit")
_CANCELLED = PlannerAnswer(Outcome.CANCELLED, reason="cancelled")


class _JobAhead:
    """A job that runs before its answer is needed."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.answer: Future[PlannerAnswer] = Future()
        self.cancelled = threading.Event()


class EngineProcesses:
    """A process with unified-planning loaded, and a child for each run. Thread-safe."""

    def __init__(self) -> None:
        """Starts the process, which loads in the background."""
        self._lock = threading.Lock()
        self._closed = False
        self._ahead: dict[threading.Event, _JobAhead] = {}
        self._process, self._requests = _start()

    def run(self, job: Job, cancelled: threading.Event) -> PlannerAnswer:
        """Blocks until the job has ended, its time limit has passed or `cancelled` is set.

        An equal job that was started with `run_ahead` is continued; another one of the same `cancelled` is ended.
        """
        ahead = self._ahead.get(cancelled)
        if ahead is None or ahead.job != job:
            self.discard(cancelled)
            return self._run(job, cancelled)
        while not wait([ahead.answer], _CANCEL_PERIOD).done:
            if cancelled.is_set():
                ahead.cancelled.set()
        self._ahead.pop(cancelled, None)
        return ahead.answer.result()

    def run_ahead(self, job: Job, cancelled: threading.Event) -> None:
        """Starts a job that `run` may be asked for soon. Does not block. `run` or `discard` has to follow.

        :param cancelled: stands for the client, which has one such job at most, and uses one thread.
        """
        old = self._ahead.get(cancelled)
        if old is not None and old.job == job:
            return
        self.discard(cancelled)
        self._ahead[cancelled] = ahead = _JobAhead(job)

        def run() -> None:
            try:
                ahead.answer.set_result(self._run(job, ahead.cancelled))
            except Exception as error:  # raised again by `run`
                ahead.answer.set_exception(error)

        threading.Thread(target=run, name="planning ahead", daemon=True).start()

    def discard(self, cancelled: threading.Event) -> None:
        """Ends the job that was started with `run_ahead`, if any."""
        ahead = self._ahead.pop(cancelled, None)
        if ahead is not None:
            ahead.cancelled.set()

    def _run(self, job: Job, cancelled: threading.Event) -> PlannerAnswer:
        with tempfile.TemporaryDirectory(prefix="skiros-plan-", ignore_cleanup_errors=True) as name:
            folder = Path(name)
            answer = self._answer(folder, job, cancelled)
            if answer is None and self._has_died():
                answer = self._answer(folder, job, cancelled)
            log = _text(folder / LOG_FILE)
            if answer is None:
                last = (log.strip().splitlines() or ["no output"])[-1]
                answer = PlannerAnswer(Outcome.FAILED, reason=f"the planner's process ended without an answer: {last}")
            files = ((name, _text(folder / name)) for name in (DOMAIN_FILE, PROBLEM_FILE) if (folder / name).exists())
            return replace(answer, log=log, files=tuple(files))

    def close(self) -> None:
        """Ends the process and its children."""
        with self._lock:
            self._closed = True
            self._stop()

    def _answer(self, folder: Path, job: Job, cancelled: threading.Event) -> PlannerAnswer | None:
        """Returns the answer to a job; None if the process ended without an answer. The child has ended afterwards."""
        with self._connect(folder) as connection:
            pid = _receive(connection, _LOADING_TIMEOUT, cancelled)
            if not isinstance(pid, int):  # cancelled, timed out, or not started
                return pid if isinstance(pid, PlannerAnswer) else None
            with contextlib.suppress(OSError):  # if the child has died, there will be no answer
                connection.send(job)
            answer = _receive(connection, job.limits.seconds + _GRACE_PERIOD, cancelled)
            if answer is _CANCELLED or answer is TIMED_OUT:
                kill_tree(pid)  # still the same process, as its connection is open
            else:
                with contextlib.suppress(EOFError, OSError):
                    connection.recv_bytes()  # until the child has ended
            return answer if isinstance(answer, PlannerAnswer) else None

    def _has_died(self) -> bool:
        """Whether the process has ended by itself."""
        with self._lock, contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_EXIT_TIMEOUT)
            return not self._closed
        return False

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
                    with contextlib.suppress(OSError):  # it has died too: there will be no answer
                        self._request(folder, theirs)
                return Connection(ours.detach())

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


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)
