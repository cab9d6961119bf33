"""Engines of unified-planning in their processes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from skiros2_common.core.processes import descendants
from skiros2_task.core.engines import EngineProcesses, Limits, Outcome
from skiros2_task.core.formula import Not, Or, conjunction
from skiros2_task.core.planners import EnginePlanner, engine_planner
from skiros2_task.core.task import validate
from support.ros import wait_until
from support.running import command, running_in
from support.transport_task import at, contain, transport_task

LIMITS = Limits(seconds=60.0)
R, A, B, C, P = "cora:Robot-0", *(f"skiros:Location-{i}" for i in range(3)), "skiros:Product-0"


@pytest.fixture
def planner(processes: EngineProcesses) -> EnginePlanner:
    return engine_planner(processes)


@pytest.mark.parametrize(("robots", "places", "products"), [(1, 2, 1), (2, 4, 3)])
def test_plan_is_valid(planner: EnginePlanner, robots: int, places: int, products: int) -> None:
    task = transport_task(robots, places, products)
    answer = planner.solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert validate(task, answer.plan) == ""


def test_disjunctive_and_negative_goals_are_solved(planner: EnginePlanner) -> None:
    goal = conjunction([Not(contain(A, P)), Or((contain(P, A), at(R, C)))])
    task = transport_task(1, 3, 1, goal)
    answer = planner.solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert validate(task, answer.plan) == ""


@pytest.mark.parametrize(
    "goal",
    [contain(P, B), conjunction([at(R, A), at(R, B)]), Or((contain(P, A), contain(P, B)))],
    ids=["no skill does it", "not both", "neither of two"],
)
def test_impossible_goal_is_proven(planner: EnginePlanner, goal: object) -> None:
    answer = planner.solve(transport_task(1, 2, 1, goal), LIMITS)  # type: ignore[arg-type]
    assert (answer.outcome, answer.plan) == (Outcome.IMPOSSIBLE, ())
    assert answer.reason


def test_answer_has_pddl_files(planner: EnginePlanner) -> None:
    answer = planner.solve(transport_task(1, 2, 1), LIMITS)
    files = dict(answer.files)
    assert set(files) == {"domain.pddl", "p01.pddl"}
    assert "(:action drive" in files["domain.pddl"]
    assert "(skiros_contain skiros_location-0 skiros_product-0)" in files["p01.pddl"]
    assert "(:goal (and \n           (skiros_contain skiros_location-1 skiros_product-0)" in files["p01.pddl"]
    assert answer.plans[0].text.splitlines()[1] == "(drive cora_robot-0 skiros_location-0 skiros_location-1)"


def test_run_leaves_no_files(planner: EnginePlanner, own_folder: Path) -> None:
    assert planner.solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    assert list((own_folder / "work").iterdir()) == []
    assert list((own_folder / "tmp").iterdir()) == []
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_runs_are_concurrent(planner: EnginePlanner) -> None:
    outcomes: dict[int, Outcome] = {}

    def solve(places: int) -> None:
        task = transport_task(1, places, 1)
        answer = planner.solve(task, LIMITS)
        outcomes[places] = answer.outcome if not validate(task, answer.plan) else Outcome.FAILED

    threads = [threading.Thread(target=solve, args=(n,)) for n in (2, 3, 4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert outcomes == dict.fromkeys((2, 3, 4), Outcome.SOLVED)


def test_socket_default_timeout_is_ignored(planner: EnginePlanner) -> None:
    """rospy sets one."""
    socket.setdefaulttimeout(30.0)
    try:
        assert planner.solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    finally:
        socket.setdefaulttimeout(None)


def test_timed_out_run_leaves_no_process(processes: EngineProcesses, own_folder: Path) -> None:
    planner = engine_planner(processes, "fast-downward-opt")
    started = time.monotonic()
    answer = planner.solve(transport_task(4, 12, 14), Limits(seconds=2.0))
    assert (answer.outcome, answer.plan) == (Outcome.TIMED_OUT, ())
    assert time.monotonic() - started < 8.0
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")
    assert list((own_folder / "tmp").iterdir()) == []


def test_cancelled_run_leaves_no_process(processes: EngineProcesses, own_folder: Path) -> None:
    planner = engine_planner(processes, "fast-downward-opt")
    cancelled = threading.Event()
    answers = []
    task = transport_task(4, 12, 14)
    thread = threading.Thread(target=lambda: answers.append(planner.solve(task, LIMITS, cancelled)))
    thread.start()
    wait_until(
        lambda: any("downward" in line for line in running_in(own_folder / "tmp").values()),
        what="the engine's own process",
    )
    cancelled.set()
    thread.join(5.0)
    assert [a.outcome for a in answers] == [Outcome.CANCELLED]
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")
    assert list((own_folder / "tmp").iterdir()) == []


def test_unknown_engine_is_reported_with_installed_ones(processes: EngineProcesses) -> None:
    answer = engine_planner(processes, "slow-upward").solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    assert "there is no planner 'slow-upward'" in answer.reason
    assert "fast-downward" in answer.reason


def test_crashed_engine_is_reported_with_log(processes: EngineProcesses) -> None:
    planner = engine_planner(processes, fast_downward_search_config="nonsense()")
    answer = planner.solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    assert "nonsense" in answer.log


def test_run_respects_memory_limit(processes: EngineProcesses) -> None:
    planner = engine_planner(processes, fast_downward_search_config="astar(blind())")
    answer = planner.solve(transport_task(4, 12, 14), Limits(seconds=60.0, memory_mb=60))
    assert (answer.outcome, answer.reason) == (
        Outcome.FAILED,
        "the planner exceeded its memory limit",
    )


def test_dead_process_is_restarted() -> None:
    before = set(descendants(os.getpid()))
    processes = EngineProcesses()
    try:
        (pid,) = set(descendants(os.getpid())) - before
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: command(pid) == "", what="the end of the process")
        assert engine_planner(processes).solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    finally:
        processes.close()
    assert set(descendants(os.getpid())) <= before


def test_process_that_dies_during_request_is_restarted() -> None:
    before = set(descendants(os.getpid()))
    processes = EngineProcesses()
    try:
        (pid,) = set(descendants(os.getpid())) - before
        os.kill(pid, signal.SIGSTOP)  # it takes nothing any more
        killing = threading.Timer(0.3, os.kill, (pid, signal.SIGKILL))
        killing.start()
        assert engine_planner(processes).solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
        killing.join()
    finally:
        processes.close()


def test_engines_end_with_killed_node(tmp_path: Path) -> None:
    """A node that is killed takes its engines with it."""
    program = """if True:
        import os, threading
        from skiros2_task.core.engines import EngineProcesses, Limits
        from skiros2_task.core.planners import engine_planner
        from support.transport_task import transport_task

        planner = engine_planner(EngineProcesses(), "fast-downward-opt")
        planner.solve(transport_task(4, 12, 14), Limits(seconds=60.0))
    """
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        "TMPDIR": str(tmp_path),
    }
    user = subprocess.Popen([sys.executable, "-c", program], env=environment)
    engines = wait_until(lambda: [p for p in descendants(user.pid) if "downward" in command(p)], what="an engine")
    processes = descendants(user.pid)
    user.kill()
    user.wait()
    assert set(engines) <= set(processes)
    wait_until(lambda: not any(command(pid) for pid in processes), timeout=5.0, what="the end of all processes")
