"""Where executions run: processes of this machine, or the workers of a Dask cluster.

On a worker too, an execution runs in a process of its own: one that hangs or crashes costs no worker.
"""

from __future__ import annotations

import importlib.util
import logging
import multiprocessing
import pickle
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from typing import Any, Protocol

from pebble import ProcessPool

from skiros2_common.core.errors import MissingPackage
from skiros2_learning.core.evaluation import Unavailable
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.worker_process import begin

log = logging.getLogger(__name__)

#: The number of processes of this machine, or the address of a Dask scheduler: dask://HOST:PORT.
Workers = int | str
DASK = "dask://"

#: How long a scheduler has to answer, and to have a worker; how long a worker may be silent (s).
_TIMEOUT = 30.0


class Pool(Protocol):
    """Runs functions of `worker_process` for one scenario."""

    @property
    def count(self) -> int:
        """How many can run at once; may change. To be asked about once a second.

        :raises Unavailable: the cluster has had no worker for 30 s, or its scheduler does not answer.
        """

    def schedule(self, function: Callable[..., Any], arguments: Sequence[Any], timeout: float) -> Future[Any]:
        """Starts a call. Its future has the result, or `TimeoutError`, `ProcessExpired`, or `Exception` if a cluster
        has given it up.

        :param timeout: s of wall time, after which the process is killed.
        """


@contextmanager
def open_pool(scenario: Scenario, workers: Workers) -> Iterator[Pool]:
    """Gives a pool whose processes end with the `with` block.

    :raises Unavailable: no scheduler or worker answers, or they have other versions of Python or Dask.
    :raises MissingPackage: Dask is not installed.
    """
    if isinstance(workers, int):
        with _processes(scenario, workers) as pool:
            yield pool
        return
    if importlib.util.find_spec("distributed") is None:
        raise MissingPackage("workers of a Dask cluster need Dask: pip install distributed")
    from distributed import Client

    try:
        found: Any = Client  # has no types
        client = found(workers.replace(DASK, "tcp://", 1), timeout=_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise Unavailable(f"no Dask scheduler at {workers}: {error}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_TIMEOUT)
            client.get_versions(check=True)
        except (TimeoutError, ValueError) as error:
            raise Unavailable(f"the Dask scheduler at {workers}: {error}") from error
        yield _Cluster(client, scenario)


class _Processes:
    def __init__(self, scenario: Scenario, count: int) -> None:
        # with `spawn`, a process shares nothing with this one
        context = multiprocessing.get_context("spawn")
        self.count = count
        self.pool = ProcessPool(count, context=context, initializer=begin, initargs=(scenario,))

    def schedule(self, function: Callable[..., Any], arguments: Sequence[Any], timeout: float) -> Future[Any]:
        return self.pool.schedule(function, arguments, timeout=timeout)


@contextmanager
def _processes(scenario: Scenario, count: int) -> Iterator[_Processes]:
    processes = _Processes(scenario, count)
    try:
        yield processes
    finally:
        processes.pool.stop()  # type: ignore[no-untyped-call]
        processes.pool.join()


# -- a cluster -----------------------------------------------------------------------------------------------------


class _Cluster:
    def __init__(self, client: Any, scenario: Scenario) -> None:
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._scenario = pickle.dumps(scenario)
        self._last_worker = self._looked = time.monotonic()
        self._seen: dict[str, float] = {}

    @property
    def count(self) -> int:
        found, reason = 0, "the cluster has no worker"
        try:
            self._restart_silent()
            found = sum(self._answer(self._client.scheduler.ncores).values())
        except (OSError, TimeoutError, CancelledError):
            reason = "the scheduler of the cluster does not answer"
        if found:
            self._last_worker = time.monotonic()
        elif time.monotonic() - self._last_worker > _TIMEOUT:
            raise Unavailable(f"{reason}; what was not finished is repeated by the next run")
        return found

    def _restart_silent(self) -> None:
        """Restarts workers that have sent nothing since the last look, so that others make their executions: they are
        stopped, or their machine is gone. Dask does so after 5 to 10 minutes."""
        if time.monotonic() - self._looked < _TIMEOUT:
            return
        self._looked = time.monotonic()
        workers = self._answer(self._client.scheduler.identity, n_workers=-1)["workers"]
        seen = {address: worker["last_seen"] for address, worker in workers.items()}
        silent = [address for address, time in seen.items() if self._seen.get(address) == time]
        self._seen = seen
        if silent:
            log.warning("the cluster: workers do not answer, and are restarted: %s", ", ".join(silent))
            self._answer(self._client.run_on_scheduler, _restart, silent, _TIMEOUT / 2)

    def _answer(self, question: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        return self._client.sync(question, *arguments, **options, callback_timeout=_TIMEOUT)

    def schedule(self, function: Callable[..., Any], arguments: Sequence[Any], timeout: float) -> Future[Any]:
        future: Future[Any] = self._executor.submit(_on_worker, self._scenario, function, arguments, timeout)
        return future


async def _restart(addresses: list[str], timeout: float, dask_scheduler: Any) -> None:
    """Restarts workers. Runs in the scheduler, which removes those that no nanny watches."""
    await dask_scheduler.restart_workers(
        addresses, timeout=timeout, wait_for_workers=False, on_error="return", stimulus_id="silent"
    )


_lock = threading.Lock()
_pools: dict[bytes, ProcessPool] = {}


def _on_worker(scenario: bytes, function: Callable[..., Any], arguments: Sequence[Any], timeout: float) -> Any:
    """Runs a call in a process beside a worker of a cluster. Called in one of the worker's threads."""
    from distributed import get_worker

    with _lock:
        if scenario not in _pools:
            for other in _pools.values():  # their processes end when they are idle
                other.close()  # type: ignore[no-untyped-call]
            _pools.clear()
            multiprocessing.current_process().daemon = False  # Dask's workers may have no children else
            context = multiprocessing.get_context("spawn")
            count, read = get_worker().state.nthreads, pickle.loads(scenario)
            _pools[scenario] = ProcessPool(count, context=context, initializer=begin, initargs=(read,))
        pool = _pools[scenario]
    return pool.schedule(function, arguments, timeout=timeout).result()
