"""A fork server for planning engines: `python -m skiros2_task.core.engine_worker FD`.

Loading unified-planning takes a second. This process loads it once, and forks a child for each request on the socket
FD. A request is a working folder, with a socket on which the child receives a pickled job and sends a pickled answer.
When FD is closed, this process and all its descendants end immediately.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import os
import resource
import signal
import socket
import sys
import threading
import time
import traceback
from multiprocessing.connection import Connection
from types import ModuleType
from typing import TYPE_CHECKING

from skiros2_task.core.engines import (
    DOMAIN_FILE,
    LOG_FILE,
    PROBLEM_FILE,
    TIMED_OUT,
    EngineCall,
    FoundPlan,
    Job,
    ListEngines,
    Outcome,
    SearchPortfolio,
    WorkerAnswer,
    kill_tree,
)
from skiros2_task.core.fast_downward import NOT_INSTALLED, PACKAGES, TRANSLATOR, read_plan, search, translate
from skiros2_task.core.task import PlanStep

if TYPE_CHECKING:
    from unified_planning.engines import Factory, PlanGenerationResultStatus

    from skiros2_task.core.up_model import UpProblem

_PR_SET_CHILD_SUBREAPER = 36  # of linux/prctl.h
_LOADING_NICENESS = 10

_IMPOSSIBLE = WorkerAnswer(Outcome.IMPOSSIBLE, reason="no sequence of the robots' skills reaches the goal")
_OUT_OF_MEMORY = WorkerAnswer(Outcome.FAILED, reason="the planner exceeded its memory limit")


def main() -> None:
    """Serves requests until the socket is closed."""
    requests = socket.socket(fileno=int(sys.argv[1]))
    loading = threading.Thread(target=_load, name="loading")
    loading.start()
    loading.join()
    gc.freeze()  # excludes the loaded modules from garbage collection in children
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children become no zombies
    while True:
        message, descriptors, _, _ = socket.recv_fds(requests, 4096, 1)
        if not message:
            kill_tree(os.getpid(), itself=False)
            return
        if os.fork() == 0:
            requests.close()
            _serve(os.fsdecode(message), Connection(descriptors[0]))
        os.close(descriptors[0])


def _load() -> None:
    """Imports the slow modules at low priority: on Linux, niceness belongs to the thread."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOADING_NICENESS)
    # unified-planning imports ConfigSpace for one annotation; scipy.stats, which comes with it, takes most of the time.
    stand_in = ModuleType("ConfigSpace")
    vars(stand_in)["ConfigurationSpace"] = object
    sys.modules["ConfigSpace"] = stand_in
    for name in ("unified_planning.engines", "unified_planning.io", "skiros2_task.core.up_model"):
        importlib.import_module(name)
    del sys.modules["ConfigSpace"]  # a planner may use it
    with contextlib.suppress(ImportError):  # reported by the job that needs it
        importlib.import_module(TRANSLATOR)


def _serve(folder: str, connection: Connection) -> None:
    """Runs a job in a child process. Does not return."""
    status = 1
    try:
        os.setsid()
        _adopt_orphans()
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        if not os.path.isdir(folder):
            return  # cancelled before the start
        os.chdir(folder)
        os.environ["TMPDIR"] = folder
        log = os.open(LOG_FILE, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(log, 1)
        os.dup2(log, 2)
        connection.send(os.getpid())
        answer = _solved(connection.recv())
        kill_tree(os.getpid(), itself=False)  # engines may end slowly
        connection.send(answer)
        status = 0
    except Exception:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)  # skips the exit handlers of the parent process


def _adopt_orphans() -> None:
    """Makes this process the parent of its orphaned descendants.

    :raises OSError: prctl failed.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_CHILD_SUBREAPER)")


def _solved(job: Job | ListEngines) -> WorkerAnswer:
    if isinstance(job, ListEngines):
        from unified_planning.environment import get_environment

        return WorkerAnswer(Outcome.SOLVED, reason="\n".join(_engines(get_environment().factory)))
    if job.limits.memory_mb is not None:
        size = job.limits.memory_mb << 20
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
    try:
        return _solve(job)
    except MemoryError:
        return _OUT_OF_MEMORY
    except Exception as error:  # an engine may raise anything
        traceback.print_exc()
        return WorkerAnswer(Outcome.FAILED, reason=f"{type(error).__name__}: {error}")


def _solve(job: Job) -> WorkerAnswer:
    if isinstance(job.work, SearchPortfolio):
        try:
            return _run_portfolio(job, job.work)
        except ModuleNotFoundError as error:
            if error.name not in PACKAGES:
                raise
            return WorkerAnswer(Outcome.FAILED, reason=NOT_INSTALLED)
    return _run_engine(job, job.work)


def _run_portfolio(job: Job, work: SearchPortfolio) -> WorkerAnswer:
    from skiros2_task.core.up_model import UpProblem  # already loaded by the parent process

    started = time.monotonic()
    gc.disable()  # many small objects with few cycles, in a short-lived process
    model = UpProblem(job.task, goal_action=work.goal_action)
    write_pddl(model)
    translate(DOMAIN_FILE, PROBLEM_FILE)
    found = search(work, started, started + job.limits.seconds)
    if found.plans:
        plans = (_found(model, name, model.named_steps(read_plan(text)), at) for name, text, at in found.plans)
        return WorkerAnswer(Outcome.SOLVED, tuple(plans))
    if found.impossible:
        return _IMPOSSIBLE
    if found.out_of_time:
        return TIMED_OUT
    return WorkerAnswer(Outcome.FAILED, reason="; ".join(found.failures))


def _run_engine(job: Job, work: EngineCall) -> WorkerAnswer:
    from unified_planning.engines.pddl_planner import PDDLPlanner
    from unified_planning.exceptions import UPNoRequestedEngineAvailableException

    from skiros2_task.core.up_model import UpProblem

    started = time.monotonic()
    # With action rolling, Aries 0.5.0 panics or returns invalid plans.
    os.environ.setdefault("ARIES_ROLL", "false")
    model = UpProblem(job.task)
    write_pddl(model)
    factory = model.environment.factory
    module, separator, cls = work.name.partition(":")
    try:
        if separator:
            factory.add_engine(work.name, module, cls)
        engine = factory.OneshotPlanner(name=work.name, params=dict(work.options))
    except UPNoRequestedEngineAvailableException:
        known = ", ".join(_engines(factory))
        return WorkerAnswer(Outcome.FAILED, reason=f"there is no planner {work.name!r}; installed: {known}")
    pddl, flat = isinstance(engine, PDDLPlanner), not engine.supports(model.problem.kind)
    if flat or not pddl:
        model = UpProblem(job.task, sparse=pddl, flat=flat)
    result = engine.solve(model.problem, timeout=job.limits.seconds)
    for message in result.log_messages or []:
        sys.stderr.write(message.message)
    sys.stderr.flush()
    if result.plan is not None:
        found = _found(model, work.name, model.steps(result.plan), time.monotonic() - started)
        return WorkerAnswer(Outcome.SOLVED, (found,))
    return _answer_without_plan(result.status)


def _found(model: UpProblem, by: str, steps: tuple[PlanStep, ...], seconds: float) -> FoundPlan:
    return FoundPlan(by, steps, seconds, "".join(f"({' '.join(model.names_of(step))})\n" for step in steps))


def write_pddl(model: UpProblem) -> None:
    """Writes domain and problem to the working folder."""
    from unified_planning.io import PDDLWriter

    writer = PDDLWriter(model.problem)
    writer.write_domain(DOMAIN_FILE)
    writer.write_problem(PROBLEM_FILE)


def _engines(factory: Factory) -> list[str]:
    """Returns the names of one-shot planners, without meta engines."""
    return sorted(n for n in factory.engines if "[" not in n and factory.engine(n).is_oneshot_planner())


def _answer_without_plan(status: PlanGenerationResultStatus) -> WorkerAnswer:
    """Returns the answer for a unified-planning status without a plan."""
    if status.name == "UNSOLVABLE_PROVEN":
        return _IMPOSSIBLE
    if status.name == "TIMEOUT":
        return TIMED_OUT
    if status.name == "UNSOLVABLE_INCOMPLETELY":
        reason = "the planner found no plan, without a proof that there is none"
        return WorkerAnswer(Outcome.FAILED, reason=reason)
    if status.name == "MEMOUT":
        return _OUT_OF_MEMORY
    return WorkerAnswer(Outcome.FAILED, reason=f"the planner ended with {status.name}")


if __name__ == "__main__":
    # Imported by name, so that pickled classes belong to this module and not to `__main__`.
    from skiros2_task.core import engine_worker

    engine_worker.main()
