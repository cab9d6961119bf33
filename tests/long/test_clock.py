"""A wall clock that is set by a day, forwards or backwards, loses and delays nothing in a cell.

The nodes run with a library that sets their wall clock and leaves the monotonic clock alone. `JOBS` sets how many.
"""

from __future__ import annotations

import itertools
import os
import random
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from support.job_cell import ROBOT, JobCell
from support.ros import Ros, wait_until

pytestmark = pytest.mark.long

SOURCE = Path(__file__).parents[1] / "support/set_clock.c"
JOBS = int(os.environ.get("JOBS", "60"))
AT_ONCE = 3
DAY = 86_400
#: What the clocks are set to, one after the other (days from the right time).
SETTINGS = (1, 0, -1, 0, 1, -1)
#: What is killed meanwhile, now and then.
NODES = (ROBOT, "/tm", "/wm", "/gateway")


class Clock:
    """The wall clock of nodes that start with its environment."""

    def __init__(self, folder: Path) -> None:
        library = folder / "set_clock.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-Wall", "-Werror", "-o", str(library), str(SOURCE)], check=True)
        self._offset = folder / "clock"
        self._offset.write_bytes(struct.pack("=q", 0))
        self.environment = {"LD_PRELOAD": str(library), "CLOCK_OFFSET": str(self._offset)}

    def set(self, days: int) -> None:
        with self._offset.open("r+b") as file:
            file.write(struct.pack("=q", days * DAY))


@pytest.fixture
def clock(ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(tmp_path)
    for key, value in clock.environment.items():
        monkeypatch.setitem(ros.master.env, key, value)
    return clock


class Shift:
    """Jobs one after the other, each once, with the times that they take."""

    def __init__(self, cell: JobCell) -> None:
        self.cell = cell
        self.numbers = itertools.count()
        self.done: list[str] = []

    def work(self, meanwhile: Callable[[], None] = lambda: None) -> float:
        """Carries some products. Returns how long that takes (s)."""
        cell, begin = self.cell, time.monotonic()
        round_, ids = next(self.numbers), []
        for product in range(AT_ONCE):
            ids.append(f"job-{round_}-{product}")
            status, answer = cell.rest.post("/api/jobs", cell.order(ids[-1], product, store=round_ % 2))
            assert status == 201, answer
        meanwhile()
        cell.wait_for(ids, 120.0)
        self.done += ids
        return time.monotonic() - begin


def test_clock_of_a_process_is_set(tmp_path: Path) -> None:
    clock = Clock(tmp_path)
    code = (
        "import datetime, sqlite3, time\nwhile input():\n"
        " of_sqlite = sqlite3.connect(':memory:').execute(\"SELECT strftime('%s')\").fetchone()[0]\n"
        " print(time.time(), datetime.datetime.now().timestamp(), of_sqlite, time.monotonic(), flush=True)"
    )
    env = {**os.environ, **clock.environment}
    with subprocess.Popen(
        [sys.executable, "-c", code], env=env, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        for days in (0, 1, -1):
            clock.set(days)
            print("?", file=process.stdin, flush=True)
            *walls, monotonic = map(float, process.stdout.readline().split())
            assert [round(wall - time.time(), -2) for wall in walls] == [days * DAY] * 3
            assert abs(monotonic - time.monotonic()) < 100.0
        print(file=process.stdin, flush=True)


def test_clock_that_is_set_by_a_day_loses_and_delays_nothing(ros: Ros, tmp_path: Path, clock: Clock) -> None:
    seed = int(os.environ.get("SEED", random.randrange(1 << 32)))
    chance, settings = random.Random(seed), itertools.cycle(SETTINGS)
    cell = JobCell(ros, tmp_path, products=AT_ONCE, skill="carry_once")
    shift = Shift(cell)
    shift.work()
    usual = [shift.work() for _ in range(5)]
    times = []

    def set_clock() -> None:
        time.sleep(chance.uniform(0.0, 0.5))  # the moment
        clock.set(next(settings))

    for number in range(JOBS // AT_ONCE):
        times.append(shift.work(set_clock))
        if number % 5 == 4:  # what has just been restarted works with a clock that is set then, too
            cell.kill(NODES[number // 5 % len(NODES)])
            clock.set(next(settings))
            cell.wait_until_ready()
    print(f"seed {seed}: {JOBS} jobs, {AT_ONCE} at once: at most {max(times):.1f} s, otherwise {max(usual):.1f} s")
    jobs = cell.jobs()
    assert [job_id for job_id in shift.done if job_id not in jobs] == []
    outcomes = {jobs[job_id]["response"]["outcome"] for job_id in shift.done}
    assert outcomes == {"succeeded"}, outcomes
    assert cell.carried().total() == len(shift.done)
    assert max(times) < 3 * max(usual) + 10.0
    # The world model has the whole history.
    moves = [entry for p in cell.products for entry in cell.world.wm.history(p) if entry.related]
    assert len(moves) >= len(shift.done)
    wait_until(lambda: cell.rest.get("/api/state")["ready"], what="a cell that still works")
