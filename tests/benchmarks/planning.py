"""From a goal to a checked plan, beside Fast Downward alone on the exported files, in the same configuration."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path

from benchmarks.measurement import Measurement, paired
from skiros2_task.core.archive import Archive
from skiros2_task.core.engine_processes import EngineProcesses
from skiros2_task.core.engine_worker import DOMAIN_FILE, PROBLEM_FILE
from skiros2_task.core.planner import Limits
from skiros2_task.core.task_planner import TaskPlanner, Verdict
from skiros2_task.core.up_planner import UpPlanner
from support.planning_world import transport_world

RUNS = 5
ALIAS = "lama-first"

#: robots, places, products
SIZES = ((1, 10, 10), (2, 20, 20))


def measure(folder: Path) -> Iterator[Measurement]:
    processes = EngineProcesses()
    planner = UpPlanner(processes, options={"fast_downward_alias": ALIAS})
    try:
        for size in SIZES:
            files = folder / f"pddl-{'-'.join(map(str, size))}"
            world = transport_world(*size)
            tasks = TaskPlanner(world.wm, planner, Limits(seconds=60.0), Archive(files))
            goal = f"(forall (?p - skiros:Product) (skiros:contain {world.places[-1]} ?p))"  # type: ignore[attr-defined]
            yield paired(
                "goal to plan, robots/places/products " + "/".join(map(str, size)),
                lambda tasks=tasks, goal=goal: _timed(lambda: _plan(tasks, goal)),  # type: ignore[misc]
                f"Fast Downward ({ALIAS}) alone",
                lambda files=files: _timed(lambda: _fast_downward(files)),  # type: ignore[misc]
                unit="s",
                runs=RUNS,
            )
    finally:
        processes.close()


def _plan(tasks: TaskPlanner, goal: str) -> None:
    result = tasks.plan(goal)
    if result.verdict is not Verdict.PLANNED:
        raise RuntimeError(f"no plan: {result.message}")


def _fast_downward(files: Path) -> None:
    driver = resources.files("up_fast_downward").joinpath("downward/fast-downward.py")
    with resources.as_file(driver) as program:
        subprocess.run(
            [sys.executable, str(program), "--alias", ALIAS, str(files / DOMAIN_FILE), str(files / PROBLEM_FILE)],
            cwd=files, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip


def _timed(call: Callable[[], None]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
