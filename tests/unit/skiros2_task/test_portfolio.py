"""Searches side by side: what is wished for, which plan wins, and nothing left of the others."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from skiros2_task.core.actions import Action, Effect, Variable
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.engine_worker import Job
from skiros2_task.core.fast_downward import Search, SideBySide
from skiros2_task.core.formula import Not, Or, conjunction
from skiros2_task.core.planner import Limits, Outcome
from skiros2_task.core.portfolio import Portfolio, Wish, makespan, planner_named
from skiros2_task.core.simulation import flaw
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.core.up_planner import UpPlanner
from support.ros import wait_until
from support.running import running_in
from support.transport_task import at, contain, transport_task

LIMITS = Limits(seconds=60.0)
R, A, B, C, P = "cora:Robot-0", *(f"skiros:Location-{i}" for i in range(3)), "skiros:Product-0"


def portfolio(processes: EngineProcesses, wish: Wish) -> Portfolio:
    return Portfolio(processes, wish, makespan())


@pytest.mark.parametrize("wish", Wish)
def test_each_wish_gives_a_plan_that_works(processes: EngineProcesses, wish: Wish) -> None:
    task = transport_task(2, 4, 3)
    answer = portfolio(processes, wish).solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert flaw(task, answer.plan) == ""
    assert set(dict(answer.files)) == {"domain.pddl", "p01.pddl", "plan.txt"}


@pytest.mark.parametrize("wish", Wish)
@pytest.mark.parametrize(
    "goal",
    [conjunction([Not(contain(A, P)), Or((contain(P, A), at(R, C)))]), Or((at(R, B), at(R, C)))],
    ids=["a conjunction", "an alternative"],
)
def test_alternatives_in_goals_are_planned_for(processes: EngineProcesses, wish: Wish, goal: object) -> None:
    task = transport_task(1, 3, 1, goal)  # type: ignore[arg-type]
    answer = portfolio(processes, wish).solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert flaw(task, answer.plan) == ""


@pytest.mark.parametrize("wish", Wish)
def test_what_cannot_be_reached_is_proven_so(processes: EngineProcesses, wish: Wish) -> None:
    answer = portfolio(processes, wish).solve(transport_task(1, 2, 1, conjunction([at(R, A), at(R, B)])), LIMITS)
    assert (answer.outcome, answer.plan) == (Outcome.IMPOSSIBLE, ())


def test_optimal_means_the_fewest_steps(processes: EngineProcesses) -> None:
    task = transport_task(1, 3, 2)
    # To each product, and with it to where it belongs; the second lies where the first one goes.
    assert len(portfolio(processes, Wish.OPTIMAL).solve(task, LIMITS).plan) == 6


def test_the_plan_with_the_least_cost_wins(processes: EngineProcesses) -> None:
    seen: list[float] = []

    def by_first_robot(_: PlanningTask, plan: Sequence[PlanStep]) -> float:
        seen.append(float(sum(R in step.arguments for step in plan)))
        return seen[-1]

    task = transport_task(3, 8, 12)
    answer = Portfolio(processes, Wish.BEST, by_first_robot).solve(task, LIMITS)
    assert len(set(seen)) > 1, "all searches use the first robot alike; this test needs another task"
    least = min(seen)
    assert by_first_robot(task, answer.plan) == least
    assert "lama-first, after" in answer.log


def test_the_best_plan_in_the_time_is_given_though_not_all_searches_ended(
    processes: EngineProcesses, own_folder: Path
) -> None:
    """Of these sizes, lama-first ends in seconds, and the others much later."""
    answer = portfolio(processes, Wish.FIRST).solve(transport_task(4, 40, 60), LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")
    assert list((own_folder / "tmp").iterdir()) == []


@pytest.mark.parametrize("wish", Wish)
def test_it_can_be_cancelled_and_leaves_no_process(processes: EngineProcesses, own_folder: Path, wish: Wish) -> None:
    cancelled = threading.Event()
    answers = []
    task = transport_task(4, 25, 60)
    planner = portfolio(processes, wish)
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


def test_its_time_is_limited(processes: EngineProcesses, own_folder: Path) -> None:
    answer = portfolio(processes, Wish.OPTIMAL).solve(transport_task(4, 12, 14), Limits(seconds=2.0))
    assert (answer.outcome, answer.plan) == (Outcome.TIMED_OUT, ())
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_its_memory_is_limited(processes: EngineProcesses) -> None:
    blind = SideBySide((Search("blind", "astar(blind())"),))
    job = Job(transport_task(4, 12, 14), blind, Limits(60.0, memory_mb=60))
    answer = processes.run(job, threading.Event()).answer
    assert answer.outcome is Outcome.FAILED
    assert "blind needs more memory than it may use" in answer.reason


def test_the_makespan_of_steps_that_two_robots_do_at_once_is_that_of_one(processes: EngineProcesses) -> None:
    other = "cora:Robot-1"
    alone, both = (PlanStep("drive", (R, A, B)),), (PlanStep("drive", (R, A, B)), PlanStep("drive", (other, A, B)))
    one = makespan()(transport_task(2, 3, 1, at(R, B)), alone)
    assert makespan()(transport_task(2, 3, 1, conjunction([at(R, B), at(other, B)])), both) == one > 0.0


def test_planners_are_chosen_by_wish_or_name(processes: EngineProcesses) -> None:
    assert planner_named(processes).name == planner_named(processes, "first").name == "fast-downward, first plan"
    assert planner_named(processes, "optimal").name == "fast-downward, optimal plan"
    other = planner_named(processes, "fast-downward-opt")
    assert isinstance(other, UpPlanner)
    assert other.name == "fast-downward-opt"


def test_the_engines_that_are_installed_are_listed(processes: EngineProcesses) -> None:
    engines = processes.engines()
    assert {"fast-downward", "fast-downward-opt"} <= set(engines)
    assert not any("[" in name for name in engines)


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
def test_a_bad_engine_gives_a_clear_result_and_the_next_request_works(
    processes: EngineProcesses, own_folder: Path, engine: str, reason: str
) -> None:
    answer = UpPlanner(processes, f"{BAD}:{engine}").solve(transport_task(1, 2, 1), LIMITS)
    assert answer.outcome is Outcome.FAILED
    assert reason in answer.reason
    assert UpPlanner(processes).solve(transport_task(1, 2, 1), LIMITS).outcome is Outcome.SOLVED
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_an_engine_that_hangs_ends_with_its_time(processes: EngineProcesses, own_folder: Path) -> None:
    """Also one that ignores what asks it to end, and has processes of its own in another session."""
    answer = UpPlanner(processes, f"{BAD}:Hanging").solve(transport_task(1, 2, 1), Limits(seconds=0.5))
    assert answer.outcome is Outcome.TIMED_OUT
    wait_until(lambda: running_in(own_folder / "tmp") == {}, 2.0, "the killed processes to be gone")


def test_an_engine_without_a_hierarchy_of_types_can_be_used(processes: EngineProcesses) -> None:
    task = transport_task(2, 3, 2)
    answer = UpPlanner(processes, f"{BAD}:Flat").solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED, answer.reason
    assert flaw(task, answer.plan) == ""


def test_an_effect_on_each_of_a_class_that_crosses_others_is_on_those_alone(processes: EngineProcesses) -> None:
    """Emptying a place of its red things leaves the others there; types cannot say what is red, as some boxes are."""
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
    answer = UpPlanner(processes).solve(task, LIMITS)
    assert [step.action for step in answer.plan] == ["sweep"], answer.reason
    assert flaw(task, answer.plan) == ""


def test_a_plan_that_does_not_work_is_told_from_one_that_does(processes: EngineProcesses) -> None:
    task = transport_task(1, 2, 1)
    answer = UpPlanner(processes, f"{BAD}:Wrong").solve(task, LIMITS)
    assert answer.outcome is Outcome.SOLVED
    assert "does not hold" in flaw(task, answer.plan)


def test_a_search_that_crashes_does_not_spoil_the_others(processes: EngineProcesses, own_folder: Path) -> None:
    """The first search's process is killed while it runs; another one's plan is given."""
    answers = []
    task = transport_task(2, 30, 40)
    thread = threading.Thread(target=lambda: answers.append(portfolio(processes, Wish.FIRST).solve(task, LIMITS)))
    thread.start()
    pid = wait_until(lambda: search_process(own_folder / "tmp", "lama-first"), what="the first search")
    os.kill(pid, 9)
    thread.join()
    assert [a.outcome for a in answers] == [Outcome.SOLVED], answers[0].reason
    assert "lama-first, after" not in answers[0].log


def search_process(folder: Path, name: str) -> int | None:
    """The process of a search that runs in a folder or below."""
    return next((pid for pid, line in running_in(folder).items() if f"{name}.plan" in line), None)
