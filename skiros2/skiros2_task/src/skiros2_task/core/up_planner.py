"""Engines of unified-planning as planners: each run in a process of its own, which can be ended at any time."""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from skiros2_task.core.engine_worker import DOMAIN_FILE, PROBLEM_FILE, Job, WorkerAnswer
from skiros2_task.core.planner import Limits, Outcome, PlannerAnswer
from skiros2_task.core.processes import kill_tree
from skiros2_task.core.task import PlanningTask

log = logging.getLogger(__name__)

DEFAULT_ENGINE = "fast-downward"

_CANCEL_PERIOD = 0.02  # s between two looks at whether a run is cancelled
_GRACE = 2.0  # s that an engine gets beyond its time to end by itself
_LOG_FILE = "planner.log"


class UpPlanner:
    """A planner that runs one engine of unified-planning.

    Loading unified-planning takes a second, so one process that has done so is kept waiting for the next task.
    """

    def __init__(
        self, engine: str = DEFAULT_ENGINE, options: Mapping[str, str] | None = None, keep_ready: bool = True
    ) -> None:
        """
        :param engine: the name by which unified-planning knows it. An unknown one is told by the first answer.
        :param options: the engine's own, such as `{"fast_downward_alias": "lama-first"}`.
        :param keep_ready: keep a process waiting for the next task, from now on and until `close`.
        """
        self._engine = engine
        self._options = tuple((options or {}).items())
        self._keep_ready = keep_ready
        self._lock = threading.Lock()
        self._spare: _Worker | None = _Worker() if keep_ready else None

    @property
    def name(self) -> str:
        return self._engine

    def solve(self, task: PlanningTask, limits: Limits, cancelled: threading.Event | None = None) -> PlannerAnswer:
        """Solves a task; see `Planner`."""
        started = time.monotonic()
        worker = self._take()
        try:
            answer = worker.run(Job(task, self._engine, self._options, limits), cancelled or threading.Event())
            self._refill()
            return PlannerAnswer(
                answer.outcome,
                answer.plan,
                answer.reason,
                worker.log(),
                worker.files(),
                time.monotonic() - started,
            )
        finally:
            worker.close()

    def close(self) -> None:
        """Ends the process that waits."""
        with self._lock:
            self._keep_ready = False
            spare, self._spare = self._spare, None
        if spare is not None:
            spare.close()

    def _take(self) -> _Worker:
        with self._lock:
            worker, self._spare = self._spare, None
        if worker is not None and worker.alive:
            return worker
        if worker is not None:
            worker.close()
        return _Worker()

    def _refill(self) -> None:
        """Makes the next process ready: after a run, so that loading does not slow the engine down."""
        with self._lock:
            if self._keep_ready and self._spare is None:
                self._spare = _Worker()


class _Worker:
    """One process of `engine_worker` and its temporary folder."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="skiros-plan-"))
        places = [p for p in sys.path if p and Path(p).exists()]
        env = {**os.environ, "PYTHONPATH": os.pathsep.join(places), "TMPDIR": str(self._folder)}
        with (self._folder / _LOG_FILE).open("wb") as log_file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "skiros2_task.core.engine_worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log_file,
                cwd=self._folder,
                env=env,
                start_new_session=True,  # a Ctrl-C in the terminal is for the node, which ends this one
            )

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def run(self, job: Job, cancelled: threading.Event) -> WorkerAnswer:
        """Gives the process its job and waits for the answer, the end of its time or `cancelled`."""
        assert self._process.stdin is not None and self._process.stdout is not None
        ends = time.monotonic() + job.limits.seconds + _GRACE
        with contextlib.suppress(BrokenPipeError):  # it is gone: the missing answer tells
            pickle.dump(job, self._process.stdin)
            self._process.stdin.flush()
        received = b""
        while True:
            readable, _, _ = select.select([self._process.stdout], [], [], _CANCEL_PERIOD)
            if readable:
                part = os.read(self._process.stdout.fileno(), 1 << 16)
                if not part:
                    return self._read(received)
                received += part
            elif cancelled.is_set():
                return WorkerAnswer(Outcome.CANCELLED, reason="cancelled")
            elif time.monotonic() > ends:
                return WorkerAnswer(Outcome.TIMED_OUT, reason="the planner found no plan in its time")

    def _read(self, received: bytes) -> WorkerAnswer:
        try:
            answer = pickle.loads(received)
        except (EOFError, pickle.UnpicklingError):
            answer = None
        if isinstance(answer, WorkerAnswer):
            return answer
        lines = self.log().strip().splitlines()
        last = f": {lines[-1]}" if lines else ""
        return WorkerAnswer(Outcome.FAILED, reason=f"the planner's process ended without an answer{last}")

    def log(self) -> str:
        """What the process and the engine printed."""
        return self._text(_LOG_FILE)

    def files(self) -> tuple[tuple[str, str], ...]:
        """The PDDL of domain and problem, by file name, as far as it was written."""
        names = (name for name in (DOMAIN_FILE, PROBLEM_FILE) if (self._folder / name).exists())
        return tuple((name, self._text(name)) for name in names)

    def _text(self, name: str) -> str:
        return (self._folder / name).read_text(encoding="utf-8", errors="replace")

    def close(self) -> None:
        """Ends the process and all under it, and removes its folder."""
        if self.alive:
            kill_tree(self._process.pid)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)
