"""The process in which engines of unified-planning run: `python -m skiros2_task.core.engine_worker FD`.

Loading unified-planning takes a second. This process does it once, and then makes a child process for each request
that comes over the socket FD: a working folder, and with it the socket over which the child gets its job and gives its
answer, both pickled. When the other side of FD is closed, or gone, all processes under this one end with it at once.
"""

from __future__ import annotations

import gc
import importlib
import os
import pickle
import resource
import signal
import socket
import sys
import threading
import traceback
from dataclasses import dataclass
from typing import Any

from skiros2_task.core.planner import Limits, Outcome
from skiros2_task.core.processes import adopt_orphans, kill_tree
from skiros2_task.core.task import PlanningTask, PlanStep

DOMAIN_FILE = "domain.pddl"
PROBLEM_FILE = "p01.pddl"
LOG_FILE = "planner.log"

_LOADING_NICENESS = 10


@dataclass(frozen=True)
class Job:
    """What to solve and how.

    :param engine: the name by which unified-planning knows it.
    :param options: the engine's own.
    """

    task: PlanningTask
    engine: str
    options: tuple[tuple[str, str], ...]
    limits: Limits


@dataclass(frozen=True)
class WorkerAnswer:
    """What came of a job."""

    outcome: Outcome
    plan: tuple[PlanStep, ...] = ()
    reason: str = ""


TIMED_OUT = WorkerAnswer(Outcome.TIMED_OUT, reason="the planner found no plan in its time")
_OUT_OF_MEMORY = WorkerAnswer(Outcome.FAILED, reason="the planner needs more memory than it may use")


def main() -> None:
    """Serves requests until the socket is closed."""
    requests = socket.socket(fileno=int(sys.argv[1]))
    loading = threading.Thread(target=_load, name="loading")
    loading.start()
    loading.join()
    gc.freeze()  # what is loaded stays; children need not look at it
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children that end leave nothing to be waited for
    while True:
        message, descriptors, _, _ = socket.recv_fds(requests, 4096, 1)
        if not message:
            kill_tree(os.getpid(), itself=False)
            return
        if os.fork() == 0:
            requests.close()
            _serve(os.fsdecode(message), socket.socket(fileno=descriptors[0]))
        os.close(descriptors[0])


def _load() -> None:
    """Imports what takes long, and leaves the processor to others meanwhile: on Linux, niceness is the thread's own."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOADING_NICENESS)
    for name in ("unified_planning.engines", "unified_planning.io", "skiros2_task.core.up_problem"):
        importlib.import_module(name)


def _serve(folder: str, connection: socket.socket) -> None:
    """The life of a child process. Does not return."""
    status = 1
    try:
        os.setsid()
        adopt_orphans()
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        if not os.path.isdir(folder):
            return  # cancelled before it began
        os.chdir(folder)
        os.environ["TMPDIR"] = folder
        log = os.open(LOG_FILE, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(log, 1)
        os.dup2(log, 2)
        stream = connection.makefile("rwb")
        pickle.dump(os.getpid(), stream)
        stream.flush()
        job = pickle.load(stream)
        answer = _solved(job)
        kill_tree(os.getpid(), itself=False)  # an engine that is told to end may take its time
        pickle.dump(answer, stream)
        stream.flush()
        status = 0
    except Exception:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)  # nothing of the process that this one was copied from is to be cleaned up here


def _solved(job: Job) -> WorkerAnswer:
    if job.limits.memory_mb is not None:
        size = job.limits.memory_mb << 20
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
    try:
        return _solve(job)
    except MemoryError:
        return _OUT_OF_MEMORY
    except Exception as error:  # an engine may raise anything; the answer tells it
        traceback.print_exc()
        return WorkerAnswer(Outcome.FAILED, reason=f"{type(error).__name__}: {error}")


def _solve(job: Job) -> WorkerAnswer:
    from unified_planning.engines import PlanGenerationResultStatus as Status
    from unified_planning.engines.pddl_planner import PDDLPlanner
    from unified_planning.exceptions import UPNoRequestedEngineAvailableException
    from unified_planning.io import PDDLWriter

    from skiros2_task.core.up_problem import UpProblem

    model = UpProblem(job.task)
    writer = PDDLWriter(model.problem)
    writer.write_domain(DOMAIN_FILE)
    writer.write_problem(PROBLEM_FILE)
    factory = model.environment.factory
    try:
        engine = factory.OneshotPlanner(name=job.engine, params=dict(job.options))
    except UPNoRequestedEngineAvailableException:
        known = ", ".join(sorted(name for name in factory.engines if factory.engine(name).is_oneshot_planner()))
        return WorkerAnswer(Outcome.FAILED, reason=f"there is no planner {job.engine!r}; installed: {known}")
    if not isinstance(engine, PDDLPlanner):
        model = UpProblem(job.task, sparse=False)
    result = engine.solve(model.problem, timeout=job.limits.seconds)
    for message in result.log_messages or []:
        sys.stderr.write(message.message)
    sys.stderr.flush()
    if result.plan is not None:
        return WorkerAnswer(Outcome.SOLVED, model.steps(result.plan))
    return _meaning(result.status, Status)


def _meaning(status: Any, names: Any) -> WorkerAnswer:
    """What a status without a plan says."""
    if status == names.UNSOLVABLE_PROVEN:
        return WorkerAnswer(Outcome.IMPOSSIBLE, reason="no sequence of the robots' skills reaches the goal")
    if status == names.TIMEOUT:
        return TIMED_OUT
    if status == names.UNSOLVABLE_INCOMPLETELY:
        reason = "the planner found no plan, and does not prove that there is none"
        return WorkerAnswer(Outcome.FAILED, reason=reason)
    if status == names.MEMOUT:
        return _OUT_OF_MEMORY
    return WorkerAnswer(Outcome.FAILED, reason=f"the planner ended with {status.name}")


if __name__ == "__main__":
    # Under its own name, so that what is pickled names this module and not the program.
    from skiros2_task.core import engine_worker

    engine_worker.main()
