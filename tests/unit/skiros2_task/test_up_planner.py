"""Engines of unified-planning, each run in a process of its own."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from skiros2_task.core.formula import Not, Or, conjunction
from skiros2_task.core.planner import Limits, Outcome
from skiros2_task.core.processes import descendants
from skiros2_task.core.simulation import flaw
from skiros2_task.core.up_planner import UpPlanner
from support.ros import wait_until
from support.transport_task import at, contain, transport_task

LIMITS = Limits(seconds=60.0)
R, A, B, C, P = "cora:Robot-0", *(f"skiros:Location-{i}" for i in range(3)), "skiros:Product-0"


@pytest.fixture(scope="module")
def planner() -> Iterator[UpPlanner]:
    planner = UpPlanner()
    yield planner
    planner.close()


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The test's working folder, and the one for temporary files."""
    (tmp_path / "work").mkdir()
    (tmp_path / "tmp").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    return tmp_path


@pytest.mark.parametrize(("robots", "places", "products"), [(1, 2, 1), (2, 4, 3)])
def test_a_plan_leads_to_the_goal(planner: UpPlanner, robots: int, places: int, products: int) -> None:
    task = transport_task(robots, places, products)
    answer = planner.solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert flaw(task, answer.plan) == ""


def test_alternatives_and_negations_in_goals_are_planned_for(planner: UpPlanner) -> None:
    goal = conjunction([Not(contain(A, P)), Or((contain(P, A), at(R, C)))])
    task = transport_task(1, 3, 1, goal)
    answer = planner.solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert flaw(task, answer.plan) == ""


@pytest.mark.parametrize(
    "goal",
    [contain(P, B), conjunction([at(R, A), at(R, B)]), Or((contain(P, A), contain(P, B)))],
    ids=["no skill does it", "not both", "neither of two"],
)
def test_a_goal_that_cannot_be_reached_is_proven_so(planner: UpPlanner, goal: object) -> None:
    answer = planner.solve(transport_task(1, 2, 1, goal), LIMITS)  # type: ignore[arg-type]
    assert (answer.outcome, answer.plan) == (Outcome.IMPOSSIBLE, ())
    assert answer.reason


def test_the_pddl_is_given_back_and_readable(planner: UpPlanner) -> None:
    files = dict(planner.solve(transport_task(1, 2, 1), LIMITS).files)
    assert set(files) == {"domain.pddl", "p01.pddl"}
    assert "(:action drive" in files["domain.pddl"]
    assert "(skiros_contain skiros_location-0 skiros_product-0)" in files["p01.pddl"]
    assert "(:goal (and \n           (skiros_contain skiros_location-1 skiros_product-0)" in files["p01.pddl"]


def test_nothing_is_written_to_the_working_folder_and_nothing_is_left(own_folder: Path) -> None:
    planner = UpPlanner(keep_ready=False)
    assert planner.solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    assert list((own_folder / "work").iterdir()) == []
    assert list((own_folder / "tmp").iterdir()) == []
    assert own_workers() == []


def test_several_plan_at_once(planner: UpPlanner) -> None:
    outcomes: dict[int, Outcome] = {}

    def solve(places: int) -> None:
        task = transport_task(1, places, 1)
        answer = planner.solve(task, LIMITS)
        outcomes[places] = answer.outcome if not flaw(task, answer.plan) else Outcome.FAILED

    threads = [threading.Thread(target=solve, args=(n,)) for n in (2, 3, 4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert outcomes == dict.fromkeys((2, 3, 4), Outcome.SOLVED)


def test_a_run_ends_with_its_time_and_leaves_no_process(own_folder: Path) -> None:
    planner = UpPlanner("fast-downward-opt", keep_ready=False)
    started = time.monotonic()
    answer = planner.solve(transport_task(4, 12, 14), Limits(seconds=2.0))
    assert (answer.outcome, answer.plan) == (Outcome.TIMED_OUT, ())
    assert time.monotonic() - started < 8.0
    assert own_workers() == []
    assert list((own_folder / "tmp").iterdir()) == []


def test_a_run_can_be_cancelled_and_leaves_no_process(own_folder: Path) -> None:
    planner = UpPlanner("fast-downward-opt", keep_ready=False)
    cancelled = threading.Event()
    answers = []
    task = transport_task(4, 12, 14)
    thread = threading.Thread(target=lambda: answers.append(planner.solve(task, LIMITS, cancelled)))
    thread.start()
    wait_until(lambda: any("downward" in line for line in own_workers()), what="the engine's own process")
    cancelled.set()
    thread.join(5.0)
    assert [a.outcome for a in answers] == [Outcome.CANCELLED]
    assert own_workers() == []
    assert list((own_folder / "tmp").iterdir()) == []


def test_an_unknown_engine_is_named_with_those_that_are_there() -> None:
    answer = UpPlanner("slow-upward", keep_ready=False).solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    assert "there is no planner 'slow-upward'" in answer.reason
    assert "fast-downward" in answer.reason


def test_an_engine_that_crashes_is_told_with_its_log() -> None:
    planner = UpPlanner(options={"fast_downward_search_config": "nonsense()"}, keep_ready=False)
    answer = planner.solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    assert "nonsense" in answer.log


def test_memory_is_limited() -> None:
    planner = UpPlanner(options={"fast_downward_search_config": "astar(blind())"}, keep_ready=False)
    answer = planner.solve(transport_task(4, 12, 14), Limits(seconds=60.0, memory_mb=60))
    assert (answer.outcome, answer.reason) == (Outcome.FAILED, "the planner needs more memory than it may use")


def test_a_waiting_process_that_died_is_replaced() -> None:
    before = set(descendants(os.getpid()))
    planner = UpPlanner()
    try:
        worker = wait_until(
            lambda: next((p for p in descendants(os.getpid()) if p not in before and command(p)), None),
            what="the process that waits",
        )
        os.kill(worker, 9)
        wait_until(lambda: not command(worker), what="the end of the process")
        assert planner.solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    finally:
        planner.close()


def command(pid: int) -> str:
    """A process's command line; "" when it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def own_workers() -> list[str]:
    """The command lines of the planning processes under this one, but for the one that waits in the fixture."""
    lines = [command(pid) for pid in descendants(os.getpid())]
    workers = [line for line in lines if "engine_worker" in line or "downward" in line]
    return workers[1:] if workers and all("engine_worker" in line for line in workers) else workers
