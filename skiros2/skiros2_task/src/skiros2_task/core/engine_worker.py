"""The process in which engines of unified-planning run: `python -m skiros2_task.core.engine_worker FD`.

Loading unified-planning takes a second. This process does it once, and then makes a child process for each request
that comes over the socket FD: a working folder, and with it the socket over which the child gets its job and gives its
answer, both pickled. When the other side of FD is closed, or gone, all processes under this one end with it at once.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import pickle
import resource
import signal
import socket
import sys
import threading
import time
import traceback
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skiros2_task.core.fast_downward import TRANSLATOR, SideBySide, read_plan, search, translate
from skiros2_task.core.planner import Limits, Outcome
from skiros2_task.core.processes import adopt_orphans, kill_tree
from skiros2_task.core.task import PlanningTask, PlanStep

if TYPE_CHECKING:
    from skiros2_task.core.up_problem import UpProblem

DOMAIN_FILE = "domain.pddl"
PROBLEM_FILE = "p01.pddl"
PLAN_FILE = "plan.txt"
LOG_FILE = "planner.log"

_LOADING_NICENESS = 10


@dataclass(frozen=True)
class EngineCall:
    """An engine of unified-planning.

    :param name: by which unified-planning knows it, or `module:Class` of one that it does not know.
    :param options: the engine's own.
    """

    name: str
    options: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Job:
    """What to solve and how."""

    task: PlanningTask
    work: EngineCall | SideBySide
    limits: Limits


@dataclass(frozen=True)
class ListEngines:
    """Asks which engines are installed; the answer's reason has a line for each."""


@dataclass(frozen=True)
class FoundPlan:
    """A plan.

    :param by: the name of the engine or search.
    :param seconds: from the start of the job until it was there.
    :param text: the steps as PDDL names them, one a line, as validators read them.
    """

    by: str
    steps: tuple[PlanStep, ...]
    seconds: float
    text: str = ""


@dataclass(frozen=True)
class WorkerAnswer:
    """What came of a job.

    :param plans: when solved, in the order in which they were found.
    """

    outcome: Outcome
    plans: tuple[FoundPlan, ...] = ()
    reason: str = ""


TIMED_OUT = WorkerAnswer(Outcome.TIMED_OUT, reason="the planner found no plan in its time")
_IMPOSSIBLE = WorkerAnswer(Outcome.IMPOSSIBLE, reason="no sequence of the robots' skills reaches the goal")
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
    with contextlib.suppress(ImportError):  # told by the job that needs it
        importlib.import_module(TRANSLATOR)


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
    except Exception as error:  # an engine may raise anything; the answer tells it
        traceback.print_exc()
        return WorkerAnswer(Outcome.FAILED, reason=f"{type(error).__name__}: {error}")


def _solve(job: Job) -> WorkerAnswer:
    if isinstance(job.work, SideBySide):
        return _side_by_side(job, job.work)
    return _call(job, job.work)


def _side_by_side(job: Job, work: SideBySide) -> WorkerAnswer:
    from skiros2_task.core.up_problem import UpProblem  # loaded by the process that this one was copied from

    started = time.monotonic()
    gc.disable()  # problem and translation are many small objects with few cycles, and the process ends soon
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


def _call(job: Job, work: EngineCall) -> WorkerAnswer:
    from unified_planning.engines import PlanGenerationResultStatus as Status
    from unified_planning.engines.pddl_planner import PDDLPlanner
    from unified_planning.exceptions import UPNoRequestedEngineAvailableException

    from skiros2_task.core.up_problem import UpProblem

    started = time.monotonic()
    # Where it rolls several actions into one, Aries (0.5.0) panics or gives plans that do not work.
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
    return _meaning(result.status, Status)


def _found(model: UpProblem, by: str, steps: tuple[PlanStep, ...], seconds: float) -> FoundPlan:
    return FoundPlan(by, steps, seconds, "".join(f"({' '.join(model.names_of(step))})\n" for step in steps))


def write_pddl(model: UpProblem) -> None:
    """Writes domain and problem to the working folder."""
    from unified_planning.io import PDDLWriter

    writer = PDDLWriter(model.problem)
    writer.write_domain(DOMAIN_FILE)
    writer.write_problem(PROBLEM_FILE)


def _engines(factory: Any) -> list[str]:
    """The engines that make plans, without those that only wrap another."""
    return sorted(n for n in factory.engines if "[" not in n and factory.engine(n).is_oneshot_planner())


def _meaning(status: Any, names: Any) -> WorkerAnswer:
    """What a status without a plan says."""
    if status == names.UNSOLVABLE_PROVEN:
        return _IMPOSSIBLE
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
