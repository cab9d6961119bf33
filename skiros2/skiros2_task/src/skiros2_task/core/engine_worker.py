"""The process in which an engine of unified-planning runs: `python -m skiros2_task.core.engine_worker`.

It loads unified-planning, waits for one job on its standard input (pickled by the process that started it), solves it
in its working folder, writes the pickled answer to its standard output and ends. When the input is closed, it ends at
once, with all processes under it. What it and the engine print goes to standard error.
"""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import sys
import threading
import traceback
from dataclasses import dataclass
from typing import Any, BinaryIO

from skiros2_task.core.planner import Limits, Outcome
from skiros2_task.core.processes import kill_tree
from skiros2_task.core.task import PlanningTask, PlanStep

DOMAIN_FILE = "domain.pddl"
PROBLEM_FILE = "p01.pddl"

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
    outcome: Outcome
    plan: tuple[PlanStep, ...] = ()
    reason: str = ""


def main() -> None:
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    loading = threading.Thread(target=_load, name="loading", daemon=True)
    loading.start()
    try:
        job = pickle.load(sys.stdin.buffer)
    except EOFError:
        os._exit(0)  # nobody wants anything
    threading.Thread(target=_end_with, args=(sys.stdin.buffer,), name="input", daemon=True).start()
    loading.join()
    answer = _solved(job)
    pickle.dump(answer, answers)
    answers.close()
    os._exit(0)  # without waiting for the thread that reads


def _load() -> None:
    """Imports what takes long, and leaves the processor to others meanwhile: on Linux, niceness is the thread's own."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOADING_NICENESS)
    for name in ("unified_planning.engines", "unified_planning.io", "skiros2_task.core.up_problem"):
        importlib.import_module(name)


def _end_with(stream: BinaryIO) -> None:
    """Waits until the process that started this one closes the input, or is gone, and ends everything."""
    while stream.read(1):
        pass
    kill_tree(os.getpid(), itself=False)
    os._exit(1)


def _solved(job: Job) -> WorkerAnswer:
    if job.limits.memory_mb is not None:
        size = job.limits.memory_mb << 20
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
    try:
        return _solve(job)
    except MemoryError:
        return WorkerAnswer(Outcome.FAILED, reason=f"more than {job.limits.memory_mb} MiB of memory were needed")
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
    return WorkerAnswer(*_meaning(result.status, Status))


def _meaning(status: Any, names: Any) -> tuple[Outcome, tuple[PlanStep, ...], str]:
    """The outcome and the reason for a status without a plan."""
    if status == names.UNSOLVABLE_PROVEN:
        return Outcome.IMPOSSIBLE, (), "no sequence of the robots' skills reaches the goal"
    if status == names.TIMEOUT:
        return Outcome.TIMED_OUT, (), "the planner found no plan in its time"
    if status == names.UNSOLVABLE_INCOMPLETELY:
        return Outcome.FAILED, (), "the planner found no plan, and does not prove that there is none"
    if status == names.MEMOUT:
        return Outcome.FAILED, (), "the planner needs more memory than it may use"
    return Outcome.FAILED, (), f"the planner ended with {status.name}"


if __name__ == "__main__":
    # Under its own name, so that what is pickled names this module and not the program.
    from skiros2_task.core import engine_worker

    engine_worker.main()
