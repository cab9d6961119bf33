"""From a goal to a checked plan, beside Fast Downward alone on the exported files, and what the plans are worth."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import resources
from pathlib import Path

from unified_planning.environment import get_environment

from benchmarks.measurement import Measurement, paired
from skiros2_task.core.engine_worker import write_pddl
from skiros2_task.core.engines import DOMAIN_FILE, PROBLEM_FILE, EngineProcesses, Limits
from skiros2_task.core.planners import engine_planner, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.store import Archive, Durations
from skiros2_task.core.up_model import UpProblem
from support.planning_world import PlanningWorld, transport_world

ALIAS = "lama-first"

#: robots, places, products, and how often
SIZES = (((1, 10, 10), 5), ((2, 20, 20), 5), ((2, 50, 50), 3), ((4, 50, 100), 3))
MAKESPAN_SIZES = ((2, 6, 6), (2, 10, 10), (3, 10, 15), (2, 20, 20))
SECONDS = {"drive": 5.0, "pick": 2.0, "place": 2.0}

#: Engines that are asked for a plan too where they are installed, and for how long (s).
OTHERS = ("aries", "tamer")
OTHERS_TIME = 30.0

#: At most so many times what Fast Downward takes alone, or so many seconds more.
RATIO, MORE = 1.3, 0.15


def measure(folder: Path) -> Iterator[Measurement]:
    processes = EngineProcesses()
    try:
        for size, runs in SIZES:
            yield _beside_fast_downward(processes, folder, size, runs)
        yield from _writing(processes, folder)
        for size in MAKESPAN_SIZES:
            yield from _makespans(processes, size)
    finally:
        processes.close()


def _beside_fast_downward(
    processes: EngineProcesses, folder: Path, size: tuple[int, int, int], runs: int
) -> Measurement:
    files = folder / f"pddl-{'-'.join(map(str, size))}"
    world = transport_world(*size)
    tasks = TaskPlanner(world.wm, planner_named(processes), Limits(seconds=60.0), Archive(files))
    found = paired(
        f"goal to plan, robots/places/products {_text(size)}",
        lambda: _timed(lambda: _plan(tasks, _goal(world))),
        f"Fast Downward ({ALIAS}) alone",
        lambda: _timed(lambda: _fast_downward(files)),
        unit="s",
        runs=runs,
    )
    return replace(found, target=round(max(RATIO, 1.0 + MORE / found.peer_median), 2))


def _writing(processes: EngineProcesses, folder: Path) -> Iterator[Measurement]:
    """From the world model to the PDDL of a thousand objects, in CPU time."""
    worlds = {size: transport_world(4, size * 2 // 5, size * 3 // 5) for size in (500, 1000)}
    planners = {size: TaskPlanner(world.wm, planner_named(processes), Limits()) for size, world in worlds.items()}
    (folder / "written").mkdir()

    def written(size: int) -> float:
        def write() -> None:
            os.chdir(folder / "written")
            write_pddl(UpProblem(planners[size].read_task(_goal(worlds[size]))))

        before = Path.cwd()
        try:
            return _timed(write, time.process_time)
        finally:
            os.chdir(before)

    twice = "twice that for 500"
    name = "domain and problem for 1000 objects"
    yield paired(name, lambda: written(1000), twice, lambda: 2 * written(500), unit="s", runs=5, limit=1.0)
    name = "growth of domain and problem from 500 to 1000 objects"
    yield paired(name, lambda: written(1000), twice, lambda: 2 * written(500), unit="s", runs=5, target=1.05)


def _makespans(processes: EngineProcesses, size: tuple[int, int, int]) -> Iterator[Measurement]:
    """How long the best plan takes with all robots at work, beside other engines' plans, dealt out in the same way."""
    world = transport_world(*size)
    durations = Durations()
    for action in TaskPlanner(world.wm, planner_named(processes), Limits()).read_task(_goal(world)).actions:
        durations.record(action.skill, "/any", SECONDS[action.skill.label])
    best = planner_named(processes, "best")
    ours = _plan(TaskPlanner(world.wm, best, Limits(OTHERS_TIME), durations=durations), _goal(world)).plan
    assert ours is not None
    name, figure = f"makespan, robots/places/products {_text(size)}", ours.makespan
    one_by_one = sum(step.end - step.start for step in ours.steps)
    yield _compared(name, figure, "its steps one after the other", one_by_one, None)
    yield _compared(name, figure, "the lower bound for its parts", ours.schedule.bound, 1.1)
    for engine in OTHERS:
        if engine not in get_environment().factory.engines:
            print(f"    {engine} is not installed", file=sys.stderr)
            continue
        other = engine_planner(processes, engine)
        theirs = TaskPlanner(world.wm, other, Limits(OTHERS_TIME), durations=durations).plan(_goal(world))
        if theirs.plan is not None:
            yield _compared(name, figure, engine, theirs.plan.makespan, 1.0)
        else:
            print(f"    {engine}, {_text(size)}: {theirs.message.splitlines()[0]}", file=sys.stderr)


def _compared(name: str, figure: float, peer: str, peers: float, target: float | None) -> Measurement:
    return Measurement(name, figure, "s", 1, peer, peers, figure / peers, target)


def _goal(world: PlanningWorld) -> str:
    return f"(forall (?p - skiros:Product) (skiros:contain {world.places[-1]} ?p))"


def _text(size: tuple[int, int, int]) -> str:
    return "/".join(map(str, size))


def _plan(tasks: TaskPlanner, goal: str) -> PlanningResult:
    result = tasks.plan(goal)
    if result.verdict is not Verdict.PLANNED:
        raise RuntimeError(f"no plan: {result.message}")
    return result


def _fast_downward(files: Path) -> None:
    driver = resources.files("up_fast_downward").joinpath("downward/fast-downward.py")
    with resources.as_file(driver) as program:
        subprocess.run(
            [sys.executable, str(program), "--alias", ALIAS, str(files / DOMAIN_FILE), str(files / PROBLEM_FILE)],
            cwd=files, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip


def _timed(call: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    start = clock()
    call()
    return clock() - start
