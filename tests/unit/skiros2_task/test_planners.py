"""Search portfolios for each plan quality, and engines chosen by name."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from skiros2_task.core.actions import Action, Effect, Variable
from skiros2_task.core.engines import EngineProcesses, Job, Limits, Outcome, Search, SearchPortfolio
from skiros2_task.core.formula import Not, Or, conjunction
from skiros2_task.core.planners import EnginePlanner, Quality, engine_planner, planner_named
from skiros2_task.core.task import validate
from support.ros import wait_until
from support.running import running_in
from support.transport_task import at, contain, transport_task

LIMITS = Limits(seconds=60.0)
R, A, B, C, P = "cora:Robot-0", *(f"skiros:Location-{i}" for i in range(3)), "skiros:Product-0"


def portfolio(processes: EngineProcesses, quality: Quality) -> EnginePlanner:
    return planner_named(processes, quality.value)


@pytest.mark.parametrize("quality", Quality)
def test_each_quality_gives_valid_plan(processes: EngineProcesses, quality: Quality) -> None:
    task = transport_task(2, 4, 3)
    answer = portfolio(processes, quality).solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert validate(task, answer.plan) == ""
    assert set(dict(answer.files)) == {"domain.pddl", "p01.pddl"}


@pytest.mark.parametrize("quality", Quality)
@pytest.mark.parametrize(
    "goal",
    [conjunction([Not(contain(A, P)), Or((contain(P, A), at(R, C)))]), Or((at(R, B), at(R, C)))],
    ids=["a conjunction", "an alternative"],
)
def test_disjunctive_goal_is_solved(processes: EngineProcesses, quality: Quality, goal: object) -> None:
    task = transport_task(1, 3, 1, goal)  # type: ignore[arg-type]
    answer = portfolio(processes, quality).solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert validate(task, answer.plan) == ""


@pytest.mark.parametrize("quality", Quality)
def test_impossible_goal_is_proven(processes: EngineProcesses, quality: Quality) -> None:
    answer = portfolio(processes, quality).solve(transport_task(1, 2, 1, conjunction([at(R, A), at(R, B)])), LIMITS)
    assert (answer.outcome, answer.plan) == (Outcome.IMPOSSIBLE, ())


def test_optimal_plan_has_fewest_steps(processes: EngineProcesses) -> None:
    task = transport_task(1, 3, 2)
    # To each product, and with it to where it belongs; the second lies where the first one goes.
    assert len(portfolio(processes, Quality.OPTIMAL).solve(task, LIMITS).plan) == 6


def test_best_plan_is_returned_at_time_limit(processes: EngineProcesses, own_folder: Path) -> None:
    """Of these sizes, lama-first ends in seconds, and the others much later."""
    answer = portfolio(processes, Quality.FIRST).solve(transport_task(4, 40, 60), LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")
    assert list((own_folder / "tmp").iterdir()) == []


@pytest.mark.parametrize("quality", Quality)
def test_cancelled_portfolio_leaves_no_process(processes: EngineProcesses, own_folder: Path, quality: Quality) -> None:
    cancelled = threading.Event()
    answers = []
    task = transport_task(4, 25, 60)
    planner = portfolio(processes, quality)
    thread = threading.Thread(target=lambda: answers.append(planner.solve(task, LIMITS, cancelled)))
    thread.start()
    wait_until(
        lambda: any("release/bin/downward" in c for c in running_in(own_folder / "tmp").values()), what="a search"
    )
    cancelled.set()
    thread.join(5.0)
    assert [a.outcome for a in answers] == [Outcome.CANCELLED]
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")
    assert list((own_folder / "tmp").iterdir()) == []


def test_search_ahead_answers_an_equal_task(
    processes: EngineProcesses, own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, client = portfolio(processes, Quality.FIRST), threading.Event()
    planner.solve_ahead(transport_task(1, 3, 2), LIMITS, client)
    with monkeypatch.context() as patch:
        patch.setattr(processes, "_run", lambda *_: pytest.fail("another search"))
        planner.solve_ahead(transport_task(1, 3, 2), LIMITS, client)
        assert planner.solve(transport_task(1, 3, 2), LIMITS, client).outcome is Outcome.SOLVED
    assert planner.solve(transport_task(1, 3, 2), LIMITS, client).outcome is Outcome.SOLVED
    assert list((own_folder / "tmp").iterdir()) == []


def test_search_ahead_ends_with_another_task_and_with_its_client(processes: EngineProcesses, own_folder: Path) -> None:
    planner, client = portfolio(processes, Quality.BEST), threading.Event()

    def search_ahead() -> None:
        planner.solve_ahead(transport_task(4, 25, 60), LIMITS, client)
        wait_until(lambda: search_process(own_folder / "tmp", "lama-first"), what="a search")

    search_ahead()
    assert planner.solve(transport_task(1, 2, 1), LIMITS, client).outcome is Outcome.SOLVED
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the end of the search ahead")
    search_ahead()
    planner.discard(client)
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the end of the search ahead")
    search_ahead()
    threading.Timer(0.2, client.set).start()
    assert planner.solve(transport_task(4, 25, 60), LIMITS, client).outcome is Outcome.CANCELLED
    wait_until(lambda: not list((own_folder / "tmp").iterdir()), 2.0, "that the folders are removed")


def test_portfolio_respects_time_limit(processes: EngineProcesses, own_folder: Path) -> None:
    answer = portfolio(processes, Quality.OPTIMAL).solve(transport_task(4, 12, 14), Limits(seconds=2.0))
    assert (answer.outcome, answer.plan) == (Outcome.TIMED_OUT, ())
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_portfolio_respects_memory_limit(processes: EngineProcesses) -> None:
    blind = SearchPortfolio((Search("blind", "astar(blind())"),))
    job = Job(transport_task(4, 12, 14), blind, Limits(60.0, memory_mb=60))
    answer = processes.run(job, threading.Event())
    assert answer.outcome is Outcome.FAILED
    assert "blind exceeded its memory limit" in answer.reason


def test_planner_named_accepts_quality_or_engine(processes: EngineProcesses) -> None:
    assert planner_named(processes).name == planner_named(processes, "first").name == "fast-downward, first plan"
    assert planner_named(processes, "optimal").name == "fast-downward, optimal plan"
    other = planner_named(processes, "fast-downward-opt")
    assert isinstance(other, EnginePlanner)
    assert other.name == "fast-downward-opt"


def test_unknown_engine_is_answered_with_the_installed_ones(processes: EngineProcesses) -> None:
    answer = engine_planner(processes, "no-such-engine").solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    _, _, names = answer.reason.partition("installed: ")
    assert {"fast-downward", "fast-downward-opt"} <= set(names.split(", "))
    assert "[" not in names


BAD = "support.bad_engines"


@pytest.mark.parametrize(
    ("engine", "reason"),
    [
        ("Raising", "out of luck"),
        ("Dying", "without an answer"),
        ("Printing", "Cannot interpret ((( fly me"),
        ("Missing", "Missing"),
    ],
)
def test_bad_engine_fails_and_next_run_succeeds(
    processes: EngineProcesses, own_folder: Path, engine: str, reason: str
) -> None:
    answer = engine_planner(processes, f"{BAD}:{engine}").solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    assert reason in answer.reason
    assert engine_planner(processes).solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_hanging_engine_is_killed_at_time_limit(processes: EngineProcesses, own_folder: Path) -> None:
    """The engine ignores signals and has processes in another session."""
    answer = engine_planner(processes, f"{BAD}:Hanging").solve(transport_task(1, 2, 1), Limits(seconds=0.5))
    assert answer.outcome is Outcome.TIMED_OUT
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_engine_without_type_hierarchy_gets_flat_problem(processes: EngineProcesses) -> None:
    task = transport_task(2, 3, 2)
    answer = engine_planner(processes, f"{BAD}:Flat").solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert validate(task, answer.plan) == ""


def test_quantified_effect_is_limited_to_crossing_class(processes: EngineProcesses) -> None:
    """A skill removes red objects from a place; the class of red objects crosses the class of boxes."""
    red, boxes = (P, "skiros:Product-1"), ("skiros:Product-1", "skiros:Product-2")
    base = transport_task(1, 1, 3)
    robot, box = base.action("drive").variables[0], Variable("?Box", "Box", ("test:Box",))
    skill = replace(base.action("drive").skill, label="sweep")
    here = contain(A, "?Red")
    sweep = Action(
        "sweep", skill, "?Robot", (), (robot, box), conjunction([]), (Effect(here, False, (("?Red", "test:Red"),)),)
    )
    members = {**base.members, "test:Red": red, "test:Box": boxes}
    task = replace(
        base, actions=(sweep,), members=members, goal=conjunction([Not(contain(A, P)), contain(A, boxes[1])])
    )
    answer = engine_planner(processes).solve(task, LIMITS)
    assert [step.action for step in answer.plan] == ["sweep"], answer.reason
    assert validate(task, answer.plan) == ""


def test_invalid_plan_is_returned_only_without_valid_one(processes: EngineProcesses) -> None:
    task = transport_task(1, 2, 1)
    answer = engine_planner(processes, f"{BAD}:Wrong").solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED
    assert "does not hold" in validate(task, answer.plan)


def test_crashed_search_does_not_stop_others(processes: EngineProcesses, own_folder: Path) -> None:
    """The first search's process is killed while it runs; another one's plan is given."""
    answers = []
    task = transport_task(2, 30, 40)
    thread = threading.Thread(target=lambda: answers.append(portfolio(processes, Quality.FIRST).solve(task, LIMITS)))
    thread.start()
    pid = wait_until(lambda: search_process(own_folder / "tmp", "lama-first"), what="the first search")
    os.kill(pid, 9)
    thread.join()
    assert [a.outcome for a in answers] == [Outcome.SOLVED], answers[0].reason
    assert "lama-first, after" not in answers[0].log


def test_killed_process_leaves_no_search_and_no_folder(own_folder: Path) -> None:
    code = (
        "from support.transport_task import transport_task\n"
        "from skiros2_task.core.engines import EngineProcesses, Limits\n"
        "from skiros2_task.core.planners import planner_named\n"
        "planner_named(EngineProcesses(), 'first').solve(transport_task(4, 40, 60), Limits(60.0))\n"
    )
    env = {**os.environ, "TMPDIR": str(own_folder / "tmp"), "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", code], env=env) as process:
        wait_until(lambda: search_process(own_folder / "tmp", "lama-first"), 60.0, "a search")
        process.kill()
    wait_until(lambda: not list((own_folder / "tmp").iterdir()), 60.0, "that the folder is removed")
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def search_process(folder: Path, name: str) -> int | None:
    """The process of a search that runs in a folder or below."""
    return next((pid for pid, line in running_in(folder).items() if f"{name}.plan" in line), None)
