"""De-ordering and scheduling of a plan in which one robot does all the work, beside one simulation of that plan.

In CPU time: both are computation in one thread, and what else runs on the machine is of no interest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from benchmarks.measurement import Measurement, paired
from skiros2_task.core.partial_order import deorder
from skiros2_task.core.schedule import schedule
from skiros2_task.core.store import Durations
from skiros2_task.core.task import validate
from support.transport_cell import transport_plan
from support.transport_task import ROBOT, transport_task

RUNS = 9
SECONDS = {"drive": 5.0, "pick": 2.0, "place": 2.0}
#: What one plan may take (s).
LIMIT = 0.07

#: robots, places, products
SIZES = ((2, 6, 6), (2, 10, 10), (3, 10, 15), (2, 20, 20), (4, 50, 50))


def measure() -> Iterator[Measurement]:
    for size in SIZES:
        task = transport_task(*size)
        durations = Durations()
        for action in task.actions:
            durations.record(action.skill, "", SECONDS[action.name])
        plan = transport_plan(task, task.members[ROBOT][:1])
        if plan is None:
            raise RuntimeError(f"no plan for {size}")
        steps, alone = plan, sum(SECONDS[step.action] for step in plan)
        found = schedule(task, deorder(task, steps), durations)
        makespan = found.makespan
        name = f"makespan of {'/'.join(map(str, size))}, scheduled"
        ratio = makespan / found.bound
        yield Measurement(name, makespan, "s", 1, "the lower bound for its parts", found.bound, ratio, 1.1)
        yield paired(
            f"de-order and schedule {'/'.join(map(str, size))}, {len(steps)} steps, {alone:g} s -> {makespan:g} s",
            lambda: _timed(lambda: schedule(task, deorder(task, steps), durations)),  # noqa: B023 - called at once
            "one simulation of the plan",
            lambda: _timed(lambda: validate(task, steps)),  # noqa: B023 - called at once
            unit="s",
            runs=RUNS,
            limit=LIMIT,
        )


def _timed(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start
