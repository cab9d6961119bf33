"""Runs the evaluations of a study in parallel processes, of this machine or of a cluster.

Each process evaluates one configuration after another. One that dies is replaced, and its evaluation repeated; a
second death on the same evaluation is its result. One that takes too long is killed. The coordinator, this process,
asks the sampler and stores the results.
"""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass

from pebble import ProcessExpired

from skiros2_learning.core.evaluation import Evaluation, Execution, Outcome, Unavailable, evaluate
from skiros2_learning.core.pools import Pool, Workers, open_pool
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.storage import StorageFailed
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import Execute, Repeat
from skiros2_learning.core.variables import Value
from skiros2_learning.core.versions import note_versions
from skiros2_learning.core.worker_process import run, run_repetition

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

    :param workers: see `Workers`.
    :param report: called after each evaluation.
    """

    def __init__(self, study: LearningStudy, workers: Workers, report: Report = lambda number, result: None) -> None:
        self._study = study
        self._workers = workers
        self._report = report
        self._running: dict[Future[Evaluation], Job] = {}
        self._repeated: list[Job] = []
        #: Time (s) that the sampler has taken.
        self.sampling_time = 0.0

    def run(self) -> None:
        """Runs until the budget is used up. `KeyboardInterrupt` ends all processes and propagates; the evaluations that
        were running are repeated by the next run.

        :raises StorageFailed: finished evaluations are kept; see `LearningStudy.keep`.
        :raises Unavailable: the cluster is gone; as with `KeyboardInterrupt`.
        """
        note_versions(self._study)
        try:
            with open_pool(self._study.scenario, self._workers) as pool:
                while self._start_jobs(pool):
                    wait(self._running, timeout=0.2, return_when=FIRST_COMPLETED)
                    for future in [each for each in self._running if each.done()]:
                        self._end(self._running.pop(future), future)
                    self._study.beat()
        except StorageFailed:
            for future, job in self._running.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._study.keep(job.number, future.result())
            raise
        finally:
            self._running.clear()
            self._repeated.clear()
            self._study.release()

    def _start_jobs(self, pool: Pool) -> bool:
        """Has as many jobs run as the pool can. Returns whether one runs."""
        while len(self._running) < max(1, pool.count) and (job := self._next_job()) is not None:
            job.attempts += 1
            arguments = (job.configuration, job.seed)
            self._running[pool.schedule(run, arguments, self._study.scenario.timeout)] = job
        return bool(self._running)

    def _next_job(self) -> Job | None:
        if self._repeated:
            return self._repeated.pop()
        if self._study.counted + self._study.running_count >= self._study.scenario.budget.evaluations:
            return None
        begin = time.monotonic()
        job = Job(*self._study.ask())
        self.sampling_time += time.monotonic() - begin
        return job

    def _end(self, job: Job, future: Future[Evaluation]) -> None:
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
        except CancelledError as error:
            raise _cluster_gone(error) from error
        except Exception as error:  # the cluster has given it up
            result = Evaluation(job.configuration, job.seed, error=f"{type(error).__name__}: {error}")
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
def repeat_in_processes(scenario: Scenario, workers: Workers) -> Iterator[Repeat]:
    """Gives a function that makes executions in parallel processes, which end with the `with` block. Each execution has
    the timeout of an evaluation, and is made again if its process dies.

    :param workers: see `Workers`; `Unavailable` is raised if the cluster is gone.
    """
    with open_pool(scenario, workers) as pool:
        yield _repeat_in(pool, scenario)


def _repeat_in(pool: Pool, scenario: Scenario) -> Repeat:
    def start(job: Execute) -> Future[Outcome]:
        arguments = (job.configuration, job.seed, job.index, job.variation)
        return pool.schedule(run_repetition, arguments, scenario.timeout)

    def outcome(job: Execute, future: Future[Outcome]) -> Outcome:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                while not wait([future], timeout=1.0).done:
                    _ = pool.count  # raises when no worker is left
                return future.result()
            except TimeoutError:
                return _late(scenario)
            except ProcessExpired as error:
                ended = _ended(error)
                log.warning("repetition %d: its process has died (%s), attempt %d", job.index, ended, attempt)
            except CancelledError as error:
                raise _cluster_gone(error) from error
            except Unavailable:
                raise
            except Exception as error:  # the cluster has given it up
                return f"{type(error).__name__}: {error}"
            if attempt < ATTEMPTS:
                future = start(job)
        return f"its process died {ATTEMPTS} times ({ended})"

    def repeat(_: Scenario, jobs: Sequence[Execute]) -> Iterator[Outcome]:
        started = [(job, start(job)) for job in jobs]
        return (outcome(*each) for each in started)

    return repeat


def _cluster_gone(error: CancelledError) -> Unavailable:
    return Unavailable(f"the cluster is gone ({error}); what was not finished is repeated by the next run")


def _late(scenario: Scenario) -> str:
    return f"not finished within {scenario.timeout:g} s of wall time"


def _ended(error: ProcessExpired) -> str:
    code = error.exitcode
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
