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
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from contextlib import contextmanager
from dataclasses import dataclass

from pebble import ProcessExpired, ProcessFuture, ProcessPool

from skiros2_learning.core.evaluation import Evaluation, Execution, Outcome, evaluate
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.storage import StorageFailed
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import Execute, Repeat
from skiros2_learning.core.variables import Value
from skiros2_learning.core.versions import note_versions
from skiros2_learning.core.worker_process import begin, run, run_repetition

log = logging.getLogger(__name__)

#: Attempts of an evaluation whose process dies.
ATTEMPTS = 2

#: Called after each evaluation with its number and its result.
Report = Callable[[int, Evaluation], None]


@dataclass
class Job:
    """An evaluation to be run."""

    number: int
    configuration: dict[str, Value]
    seed: int
    attempts: int = 0


class Runner:
    """Runs a study until its budget is used up.

    :param count: number of processes.
    :param report: called after each evaluation.
    """

    def __init__(self, study: LearningStudy, count: int, report: Report = lambda number, result: None) -> None:
        self._study = study
        self._count = count
        self._report = report
        self._running: dict[ProcessFuture[Evaluation], Job] = {}
        self._repeated: list[Job] = []
        #: Time (s) that the sampler has taken.
        self.sampling_time = 0.0

    def run(self) -> None:
        """Runs until the budget is used up. `KeyboardInterrupt` ends all processes and propagates; the evaluations that
        were running are repeated by the next run.

        :raises StorageFailed: finished evaluations are kept; see `LearningStudy.keep`.
        """
        scenario = self._study.scenario
        note_versions(self._study)
        # with `spawn`, a process shares nothing with this one
        context = multiprocessing.get_context("spawn")
        pool = ProcessPool(self._count, context=context, initializer=begin, initargs=(scenario,))
        try:
            while True:
                while len(self._running) < self._count and (job := self._next_job()) is not None:
                    job.attempts += 1
                    future = pool.schedule(run, (job.configuration, job.seed), timeout=scenario.timeout)
                    self._running[future] = job
                if not self._running:
                    return
                wait(self._running, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in [each for each in self._running if each.done()]:
                    self._end(self._running.pop(future), future)
                self._study.beat()
        except StorageFailed:
            for future, job in self._running.items():
                if future.done() and future.exception() is None:
                    self._study.keep(job.number, future.result())
            raise
        finally:
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()
            self._running.clear()
            self._repeated.clear()
            self._study.release()

    def _next_job(self) -> Job | None:
        if self._repeated:
            return self._repeated.pop()
        if self._study.counted + self._study.running_count >= self._study.scenario.budget.evaluations:
            return None
        begin = time.monotonic()
        job = Job(*self._study.ask())
        self.sampling_time += time.monotonic() - begin
        return job

    def _end(self, job: Job, future: ProcessFuture[Evaluation]) -> None:
        """Stores a result, or repeats the evaluation of a process that has died."""
        try:
            result: Evaluation = future.result()
        except TimeoutError:
            result = Evaluation(job.configuration, job.seed, error=_late(self._study.scenario))
        except ProcessExpired as error:
            ended = _ended(error)
            log.warning("evaluation %d: its process has died (%s), attempt %d", job.number, ended, job.attempts)
            if job.attempts < ATTEMPTS:
                self._repeated.append(job)
                return
            text = f"its process died {ATTEMPTS} times ({ended})"
            result = Evaluation(job.configuration, job.seed, error=text)
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
        note_versions(study)
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


@contextmanager
def repeat_in_processes(scenario: Scenario, count: int) -> Iterator[Repeat]:
    """Gives a function that makes executions in parallel processes, which end with the `with` block. Each execution has
    the timeout of an evaluation, and is made again if its process dies.

    :param count: number of processes.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPool(count, context=context, initializer=begin, initargs=(scenario,))  # they start when needed

    def start(job: Execute) -> ProcessFuture[Outcome]:
        arguments = (job.configuration, job.seed, job.index, job.variation)
        return pool.schedule(run_repetition, arguments, timeout=scenario.timeout)

    def outcome(job: Execute, future: ProcessFuture[Outcome]) -> Outcome:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                return future.result()
            except TimeoutError:
                return _late(scenario)
            except ProcessExpired as error:
                ended = _ended(error)
                log.warning("repetition %d: its process has died (%s), attempt %d", job.index, ended, attempt)
            if attempt < ATTEMPTS:
                future = start(job)
        return f"its process died {ATTEMPTS} times ({ended})"

    def repeat(_: Scenario, jobs: Sequence[Execute]) -> Iterator[Outcome]:
        started = [(job, start(job)) for job in jobs]
        return (outcome(*each) for each in started)

    try:
        yield repeat
    finally:
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def _late(scenario: Scenario) -> str:
    return f"not finished within {scenario.timeout:g} s of wall time"


def _ended(error: ProcessExpired) -> str:
    code = error.exitcode
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
