"""Runs the evaluations of a study in parallel processes.

Each process evaluates one configuration after another. One that dies is replaced, and its evaluation repeated; a
second death on the same evaluation is its result. One that takes too long is killed. The coordinator, this process,
asks the sampler and stores the results.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

from skiros2_learning.core.evaluation import Evaluation, Execution, evaluate
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.storage import StorageFailed
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.variables import Value
from skiros2_learning.core.worker_process import work

log = logging.getLogger(__name__)

#: Attempts of an evaluation whose process dies.
ATTEMPTS = 2
#: Time that an ending process has (s).
_END_TIMEOUT = 2.0

#: Called after each evaluation with its number and its result.
Report = Callable[[int, Evaluation], None]


@dataclass
class Job:
    """An evaluation to be run."""

    number: int
    configuration: dict[str, Value]
    seed: int
    attempts: int = 0


class Worker:
    """A process that evaluates. Started with `spawn`: it shares nothing with this process."""

    def __init__(self, scenario: Scenario) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other = context.Pipe()
        self.process = context.Process(target=work, args=(other, scenario), daemon=True)
        self.process.start()
        other.close()
        self.job: Job | None = None
        self._deadline = 0.0
        self._timeout = scenario.timeout

    def start(self, job: Job) -> None:
        """Starts an evaluation.

        :raises OSError: the process has died.
        """
        self.job = job
        job.attempts += 1
        self._deadline = time.monotonic() + self._timeout
        self.connection.send((job.configuration, job.seed))

    @property
    def is_late(self) -> bool:
        return self.job is not None and time.monotonic() > self._deadline

    def end(self) -> None:
        """Ends the process."""
        self.connection.close()
        if self.process.is_alive():
            self.process.terminate()
            self.process.join(_END_TIMEOUT)
        if self.process.is_alive():
            self.process.kill()
        self.process.join()


class Runner:
    """Runs a study until its budget is used up.

    :param count: number of processes.
    :param report: called after each evaluation.
    """

    def __init__(self, study: LearningStudy, count: int, report: Report = lambda number, result: None) -> None:
        self._study = study
        self._count = count
        self._report = report
        self._workers: list[Worker] = []
        self._repeated: list[Job] = []
        #: Time (s) that the sampler has taken.
        self.sampling_time = 0.0

    def run(self) -> None:
        """Runs until the budget is used up. `KeyboardInterrupt` ends all processes and propagates; the evaluations that
        were running are repeated by the next run.

        :raises StorageFailed: finished evaluations are kept; see `LearningStudy.keep`.
        """
        budget = self._study.scenario.budget.evaluations
        try:
            while True:
                self._fill(budget)
                if not any(worker.job is not None for worker in self._workers):
                    return
                self._collect()
                self._study.beat()
        except StorageFailed:
            self._keep_finished()
            raise
        finally:
            for worker in self._workers:
                worker.end()
            self._workers.clear()
            self._repeated.clear()
            self._study.release()

    def _keep_finished(self) -> None:
        """Keeps the results that the processes have sent, when the storage fails."""
        for worker in self._workers:
            if worker.job is not None and worker.connection.poll():
                with suppress(EOFError, OSError):
                    self._study.keep(worker.job.number, worker.connection.recv())

    def _fill(self, budget: int) -> None:
        """Gives each free process an evaluation, as far as the budget allows."""
        while len(self._workers) < self._count:
            self._workers.append(Worker(self._study.scenario))
        for worker in [worker for worker in self._workers if worker.job is None]:
            if self._repeated:
                job = self._repeated.pop()
            elif self._study.counted + self._study.running_count < budget:
                begin = time.monotonic()
                job = Job(*self._study.ask())
                self.sampling_time += time.monotonic() - begin
            else:
                return
            try:
                worker.start(job)
            except OSError:
                self._replace(worker, job)

    def _collect(self) -> None:
        """Waits for the next event: a result, a death, or a deadline."""
        connections: dict[Any, Worker] = {w.connection: w for w in self._workers if w.job is not None}
        for ready in wait(list(connections), timeout=0.2):
            worker = connections[ready]
            job = worker.job
            assert job is not None
            try:
                result: Evaluation = worker.connection.recv()
            except (EOFError, OSError):
                self._replace(worker, job)
                continue
            worker.job = None
            self._tell(job, result)
        for worker in [worker for worker in self._workers if worker.is_late]:
            job = worker.job
            assert job is not None
            self._remove(worker)
            text = f"not finished within {self._study.scenario.timeout:g} s of wall time"
            self._tell(job, Evaluation(job.configuration, job.seed, error=text))

    def _replace(self, worker: Worker, job: Job) -> None:
        """Repeats the evaluation of a process that has died, or gives up."""
        worker.process.join(_END_TIMEOUT)
        code = worker.process.exitcode
        self._remove(worker)
        ended = f"signal {signal.Signals(-code).name}" if code is not None and code < 0 else f"exit status {code}"
        log.warning("evaluation %d: its process has died (%s), attempt %d", job.number, ended, job.attempts)
        if job.attempts < ATTEMPTS:
            self._repeated.append(job)
            return
        self._tell(job, Evaluation(job.configuration, job.seed, error=f"its process died {ATTEMPTS} times ({ended})"))

    def _remove(self, worker: Worker) -> None:
        worker.end()
        self._workers.remove(worker)

    def _tell(self, job: Job, result: Evaluation) -> None:
        self._study.tell(job.number, result)
        self._report(job.number, result)


class OneByOne:
    """Runs a study in this process, one evaluation at a time. Arguments and interruption as of `Runner`.

    :param execution: of the evaluations.
    """

    def __init__(self, study: LearningStudy, execution: Execution, report: Report) -> None:
        self._study = study
        self._execution = execution
        self._report = report
        self.sampling_time = 0.0

    def run(self) -> None:
        """Runs until the budget is used up.

        :raises Unavailable: by the execution; the evaluation is repeated by the next run.
        """
        study = self._study
        try:
            while study.counted < study.scenario.budget.evaluations:
                begin = time.monotonic()
                number, configuration, seed = study.ask()
                self.sampling_time += time.monotonic() - begin
                result = evaluate(study.scenario, configuration, seed, self._execution)
                study.tell(number, result)
                self._report(number, result)
        finally:
            study.release()
