"""A fork server for planning engines: `python -m skiros2_task.core.engine_worker FD`.

Loading unified-planning takes a second. This process loads it once, and forks a child for each request on the socket
FD. A request is a working folder, with a socket on which the child receives a pickled job and sends a pickled answer.
When FD is closed, this process and all its descendants end immediately, and the remaining working folders are
removed: whoever made them may have been killed.

A portfolio of Fast Downward searches runs on one translation of the task: translation takes as long as search.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import os
import resource
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from importlib import resources
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from skiros2_task.core.engines import (
    DOMAIN_FILE,
    LOG_FILE,
    MIN_GRACE_PERIOD,
    PROBLEM_FILE,
    TIMED_OUT,
    EngineCall,
    FoundPlan,
    Job,
    Outcome,
    PlannerAnswer,
    Search,
    SearchPortfolio,
    kill_tree,
)
from skiros2_task.core.task import PlanStep

if TYPE_CHECKING:
    from unified_planning.engines import Factory, PlanGenerationResultStatus

    from skiros2_task.core.up_model import UpProblem

_PR_SET_CHILD_SUBREAPER = 36  # of linux/prctl.h
_LOADING_NICENESS = 10

#: The packages that Fast Downward consists of. They are optional.
_FAST_DOWNWARD = ("fast_downward", "up_fast_downward")
_TRANSLATOR = "fast_downward.translate.main"
_PROGRAM = "downward/builds/release/bin/downward"
_SAS_FILE = "output.sas"
_NICENESS = 19  # of all but the first search

# Exit codes: https://www.fast-downward.org/latest/documentation/exit-codes
_PROVEN = (10, 11)
_FAILURES = {
    12: "found no plan, without a proof that there is none",
    **dict.fromkeys((20, 22, 24), "exceeded its memory limit"),
    **dict.fromkeys((21, 23), "ran out of time"),
}

_IMPOSSIBLE = PlannerAnswer(Outcome.IMPOSSIBLE, reason="no sequence of the robots' skills reaches the goal")
_OUT_OF_MEMORY = PlannerAnswer(Outcome.FAILED, reason="the planner exceeded its memory limit")
_NOT_INSTALLED = PlannerAnswer(
    Outcome.FAILED,
    reason="the planner Fast Downward is not installed (requirements/planner.txt): planning needs it, or another "
    "planner",
)


def main() -> None:
    """Serves requests until the socket is closed."""
    requests = socket.socket(fileno=int(sys.argv[1]))
    loading = threading.Thread(target=_load, name="loading")
    loading.start()
    loading.join()
    gc.freeze()  # excludes the loaded modules from garbage collection in children
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children become no zombies
    folders: list[str] = []
    while True:
        message, descriptors, _, _ = socket.recv_fds(requests, 4096, 1)
        if not message:
            kill_tree(os.getpid(), itself=False)
            for folder in folders:
                shutil.rmtree(folder, ignore_errors=True)
            return
        folders = [*filter(os.path.isdir, folders), os.fsdecode(message)]
        if os.fork() == 0:
            requests.close()
            _serve(folders[-1], Connection(descriptors[0]))
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
    # Imports all engines that are installed, wanted or not: Tamer takes most of a second. Children have them then.
    importlib.import_module("unified_planning.environment").get_environment()
    with contextlib.suppress(ImportError):  # reported by the job that needs it
        importlib.import_module(_TRANSLATOR)


# -- in the child of a job ---------------------------------------------------------------------------------------------


def _serve(folder: str, connection: Connection) -> None:
    """Runs a job in a child process. Does not return."""
    status = 1
    try:
        os.setsid()
        if ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
            raise OSError("prctl(PR_SET_CHILD_SUBREAPER)")  # orphaned descendants would not be killed
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


def _solved(job: Job) -> PlannerAnswer:
    if job.limits.memory_mb is not None:
        size = job.limits.memory_mb << 20
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
    try:
        if isinstance(job.work, SearchPortfolio):
            return _run_portfolio(job, job.work)
        return _run_engine(job, job.work)
    except MemoryError:
        return _OUT_OF_MEMORY
    except Exception as error:  # an engine may raise anything
        if isinstance(error, ModuleNotFoundError) and error.name in _FAST_DOWNWARD:
            return _NOT_INSTALLED
        traceback.print_exc()
        return PlannerAnswer(Outcome.FAILED, reason=f"{type(error).__name__}: {error}")


def _found(model: UpProblem, by: str, steps: tuple[PlanStep, ...], started: float) -> FoundPlan:
    text = "".join(f"({' '.join(model.names_of(step))})\n" for step in steps)
    return FoundPlan(by, steps, time.monotonic() - started, text)


def write_pddl(model: UpProblem) -> None:
    """Writes domain and problem to the working folder."""
    from unified_planning.io import PDDLWriter

    writer = PDDLWriter(model.problem)
    writer.write_domain(DOMAIN_FILE)
    writer.write_problem(PROBLEM_FILE)


# -- engines of unified-planning ---------------------------------------------------------------------------------------


def _run_engine(job: Job, work: EngineCall) -> PlannerAnswer:
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
        return PlannerAnswer(Outcome.FAILED, reason=f"there is no planner {work.name!r}; installed: {known}")
    pddl, flat = isinstance(engine, PDDLPlanner), not engine.supports(model.problem.kind)
    if flat or not pddl:
        model = UpProblem(job.task, sparse=pddl, flat=flat)
    result = engine.solve(model.problem, timeout=job.limits.seconds)
    for message in result.log_messages or []:
        sys.stderr.write(message.message)
    sys.stderr.flush()
    if result.plan is not None:
        return PlannerAnswer(Outcome.SOLVED, (_found(model, work.name, model.steps(result.plan), started),))
    return _answer_without_plan(result.status)


def _engines(factory: Factory) -> list[str]:
    """Returns the names of one-shot planners, without meta engines."""
    return sorted(n for n in factory.engines if "[" not in n and factory.engine(n).is_oneshot_planner())


def _answer_without_plan(status: PlanGenerationResultStatus) -> PlannerAnswer:
    """Returns the answer for a unified-planning status without a plan."""
    known = {"UNSOLVABLE_PROVEN": _IMPOSSIBLE, "TIMEOUT": TIMED_OUT, "MEMOUT": _OUT_OF_MEMORY}
    if status.name == "UNSOLVABLE_INCOMPLETELY":
        return PlannerAnswer(Outcome.FAILED, reason="the planner found no plan, without a proof that there is none")
    return known.get(status.name) or PlannerAnswer(Outcome.FAILED, reason=f"the planner ended with {status.name}")


# -- search portfolios of Fast Downward --------------------------------------------------------------------------------


def _run_portfolio(job: Job, work: SearchPortfolio) -> PlannerAnswer:
    """Runs the searches, as many at once as there are idle cores. All have ended when it returns."""
    from skiros2_task.core.up_model import UpProblem  # already loaded by the parent process

    started = time.monotonic()
    ends = started + job.limits.seconds
    gc.disable()  # many small objects with few cycles, in a short-lived process
    model = UpProblem(job.task, goal_action=work.goal_action)
    write_pddl(model)
    importlib.import_module("fast_downward.translate.options").set_options(
        [DOMAIN_FILE, PROBLEM_FILE, "--sas-file", _SAS_FILE]
    )
    importlib.import_module(_TRANSLATOR).main()
    waiting = list(work.searches)
    running: dict[int, _RunningSearch] = {}
    plans: list[FoundPlan] = []
    failures: list[str] = []
    cores = max(1, len(os.sched_getaffinity(0)) - int(os.getloadavg()[0]))  # idle ones
    with resources.as_file(resources.files("up_fast_downward").joinpath(_PROGRAM)) as program:
        while (waiting or running) and time.monotonic() < ends:
            while waiting and len(running) < cores:
                new = _RunningSearch(waiting.pop(0), program, first=len(waiting) == len(work.searches) - 1)
                running[new.descriptor] = new
            for descriptor in _ended(running, ends):
                done = running.pop(descriptor)
                code, text = done.close()
                if text:
                    names = [line.strip("() ").split() for line in text.splitlines() if line.startswith("(")]
                    plans.append(_found(model, done.search.name, model.named_steps(names), started))
                    if len(plans) == 1 and work.grace_share is not None:
                        grace = max(MIN_GRACE_PERIOD, work.grace_share * plans[0].seconds)
                        ends = min(ends, time.monotonic() + grace)
                elif code in _PROVEN and not plans:
                    return _IMPOSSIBLE  # the caller kills the other searches
                else:
                    failures.append(f"{done.search.name} {_FAILURES.get(code, f'ended with code {code}')}")
    if plans:
        return PlannerAnswer(Outcome.SOLVED, tuple(plans))
    return TIMED_OUT if running or waiting else PlannerAnswer(Outcome.FAILED, reason="; ".join(failures))


class _RunningSearch:
    """A running search."""

    def __init__(self, search: Search, program: Path, first: bool) -> None:
        """
        :param first: gives this search priority over the others.
        """
        self.search = search
        self._plan_file = Path(f"{search.name}.plan")
        arguments = [str(program), "--internal-plan-file", str(self._plan_file), "--search", search.expression]
        with open(_SAS_FILE, "rb") as task:
            self._process = subprocess.Popen(arguments, stdin=task)
        if not first:
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS)
        self.descriptor = os.pidfd_open(self._process.pid)

    def close(self) -> tuple[int, str]:
        """Returns the exit code, and the text of the plan or "", after the search has ended."""
        os.close(self.descriptor)
        code = self._process.wait()
        # A plan without its last line, the cost, is incomplete.
        text = self._plan_file.read_text() if self._plan_file.exists() else ""
        return code, text if "; cost = " in text else ""


def _ended(running: dict[int, _RunningSearch], ends: float) -> Iterator[int]:
    """Waits until a search has ended or the deadline has passed. Yields the descriptors of ended searches."""
    poll = select.poll()
    for descriptor in running:
        poll.register(descriptor, select.POLLIN)
    seconds = max(0.0, ends - time.monotonic())
    for descriptor, _ in poll.poll(seconds * 1000):
        yield descriptor


if __name__ == "__main__":
    # Imported by name, so that pickled classes belong to this module and not to `__main__`.
    from skiros2_task.core import engine_worker

    engine_worker.main()
