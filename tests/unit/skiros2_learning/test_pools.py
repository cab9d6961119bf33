"""Processes of this machine and workers of a Dask cluster have the same results, also when a process, a worker or the
scheduler dies. With executions of support.learning_tasks."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from distributed import Client, LocalCluster

from skiros2_learning.core import pools
from skiros2_learning.core.evaluation import Evaluation, Unavailable, evaluate
from skiros2_learning.core.pools import Workers
from skiros2_learning.core.scenario import Scenario, parse_scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import validate
from skiros2_learning.core.workers import Runner, repeat_in_processes
from support.learning_scenarios import scenario_text

TEXT = scenario_text("parabola", "EXECUTION", evaluations=6, initial=3, settings="{folder: FOLDER}", timeout="60")


@contextmanager
def cluster(folder: Path, count: int = 2) -> Iterator[Any]:
    """Workers with one thread each."""
    options = {"dashboard_address": ":0", "local_directory": str(folder)}
    with LocalCluster(n_workers=count, threads_per_worker=1, **options) as found:
        yield found


@contextmanager
def lone_worker(found: Any, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """One more worker that no other process watches."""
    options = ["--no-nanny", "--nthreads", "1", "--local-directory", str(folder)]
    command = [sys.executable, "-m", "dask", "worker", found.scheduler_address, *options]
    count = len(found.scheduler.workers) + 1
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with Client(found, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)
        yield process
    finally:
        process.kill()
        process.wait()


def address(found: Any) -> str:
    return str(found.scheduler_address).replace("tcp://", "dask://")


@pytest.fixture(scope="module")
def dask(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with cluster(tmp_path_factory.mktemp("dask")) as found:
        yield address(found)


@pytest.fixture(params=["processes", "cluster"])
def workers(request: pytest.FixtureRequest) -> Workers:
    return 2 if request.param == "processes" else str(request.getfixturevalue("dask"))


def scenario(folder: Path, execution: str = "parabola", timeout: str = "60") -> Scenario:
    text = TEXT.replace("timeout: 60", f"timeout: {timeout}")
    return parse_scenario(text.replace("EXECUTION", execution).replace("FOLDER", str(folder)), folder)


def run(plan: Scenario, folder: Path, workers: Workers) -> dict[int, Evaluation]:
    study = LearningStudy.create(plan, folder / "study")
    Runner(study, workers).run()
    return study.results()


def test_results_are_those_of_this_process(tmp_path: Path, workers: Workers) -> None:
    plan = scenario(tmp_path)
    results = run(plan, tmp_path, workers)
    assert len(results) == 6
    for result in results.values():
        assert result == evaluate(plan, result.configuration, result.seed)
    study = LearningStudy.open(tmp_path / "study")
    with repeat_in_processes(plan, workers) as repeat:
        found = validate(study, repeat)
    assert sum(each.count for each in found.candidates) > 0


def test_evaluation_of_a_killed_process_is_repeated(tmp_path: Path, workers: Workers) -> None:
    results = run(scenario(tmp_path, "dies_once"), tmp_path, workers)
    assert (tmp_path / "died").exists()
    assert [result.error for result in results.values()] == [""] * 6


def test_processes_that_die_again_or_hang_are_results_with_a_reason(tmp_path: Path, workers: Workers) -> None:
    dead = run(scenario(tmp_path, "always_dies").derived(evaluations=1), tmp_path / "dead", workers)
    assert [result.error for result in dead.values()] == ["its process died 2 times (signal SIGKILL)"]
    late = run(scenario(tmp_path, "hangs", timeout="0.5").derived(evaluations=1), tmp_path / "late", workers)
    assert [result.error for result in late.values()] == ["not finished within 0.5 s of wall time"]


@pytest.mark.long
def test_other_workers_take_over_from_one_that_is_killed(tmp_path: Path) -> None:
    with cluster(tmp_path) as found:

        def kill(number: int, result: Evaluation) -> None:
            if not killed:
                killed.append(next(iter(found.workers.values())).process.process.pid)
                os.kill(killed[0], signal.SIGKILL)

        killed: list[int] = []
        study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
        Runner(study, address(found), kill).run()
    assert [result.error for result in study.results().values()] == [""] * 6


@pytest.mark.long
@pytest.mark.parametrize("with_nanny", [True, False])
def test_other_workers_take_over_from_one_that_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, with_nanny: bool
) -> None:
    monkeypatch.setattr(pools, "_TIMEOUT", 12.0)
    with cluster(tmp_path, 1) as found, lone_worker(found, tmp_path) as lone:
        worker = next(iter(found.workers.values())).process.process.pid if with_nanny else lone.pid
        stopped = []

        def stop(number: int, result: Evaluation) -> None:
            if not stopped:
                stopped.append(worker)
                os.kill(worker, signal.SIGSTOP)

        study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
        Runner(study, address(found), stop).run()
    assert [result.error for result in study.results().values()] == [""] * 6


@pytest.mark.long
def test_study_continues_after_its_cluster_has_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pools, "_TIMEOUT", 10.0)
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    with cluster(tmp_path) as found:

        def end(number: int, result: Evaluation) -> None:
            if study.counted == 2:
                found.close()

        with pytest.raises(Unavailable):
            Runner(study, address(found), end).run()
    again = LearningStudy.open(tmp_path / "study")
    again.requeue_interrupted()
    Runner(again, 1).run()
    assert [result.error for result in again.results().values()] == [""] * 6


@pytest.mark.long
def test_cluster_without_workers_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pools, "_TIMEOUT", 10.0)
    plan = scenario(tmp_path)
    study = LearningStudy.create(plan, tmp_path / "study")
    with cluster(tmp_path) as found:
        with pytest.raises(Unavailable, match="the cluster has no worker"):
            Runner(study, address(found), lambda number, result: found.scale(0)).run()
        study.requeue_interrupted()
        Runner(study, 1).run()
        found.scale(1)
        with repeat_in_processes(plan, address(found)) as repeat, pytest.raises(Unavailable):
            found.scale(0)
            validate(study, repeat)


def test_scheduler_that_does_not_answer_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pools, "_TIMEOUT", 0.5)
    study = LearningStudy.create(scenario(tmp_path), tmp_path / "study")
    with pytest.raises(Unavailable, match="no Dask scheduler at dask://"):
        Runner(study, "dask://127.0.0.1:1").run()
