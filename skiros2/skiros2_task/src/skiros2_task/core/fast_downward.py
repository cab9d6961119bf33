"""Runs a portfolio of Fast Downward searches on one translation of a task.

Translation takes as long as search, so it runs once, in the process that has loaded the translator. Requires a process
of its own (see `engine_worker`): the translator has global options, and a run may be killed at any time.
"""

from __future__ import annotations

import importlib
import os
import select
import subprocess
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from skiros2_task.core.engines import Search, SearchPortfolio

#: The packages that Fast Downward consists of. They are optional.
PACKAGES = ("fast_downward", "up_fast_downward")

NOT_INSTALLED = (
    "the planner Fast Downward is not installed (requirements/planner.txt): planning needs it, or another planner"
)

TRANSLATOR = "fast_downward.translate.main"
_NICENESS = 19  # of all but the first search
_PROGRAM = "downward/builds/release/bin/downward"
_SAS_FILE = "output.sas"

# Exit codes: https://www.fast-downward.org/latest/documentation/exit-codes
_PROVEN = (10, 11)
_EXPLORED_INCOMPLETELY = 12
_OUT_OF_MEMORY = (20, 22, 24)
_OUT_OF_TIME = (21, 23)


MIN_GRACE_PERIOD = 0.15  # s


@dataclass(frozen=True)
class Found:
    """The results of a portfolio.

    :param plans: (name of the search, text of the plan, time when it was found (s)) in the order of time.
    :param impossible: a search has proven that there is no plan.
    :param out_of_time: some searches had not ended.
    :param failures: messages of searches that ended without a plan.
    """

    plans: tuple[tuple[str, str, float], ...]
    impossible: bool = False
    out_of_time: bool = False
    failures: tuple[str, ...] = ()


def translate(domain: str, problem: str) -> None:
    """Writes the translated task to the working folder. Raises the translator's exceptions."""
    options = importlib.import_module("fast_downward.translate.options")
    options.set_options([domain, problem, "--sas-file", _SAS_FILE])
    importlib.import_module(TRANSLATOR).main()


def search(work: SearchPortfolio, started: float, ends: float) -> Found:
    """Runs a portfolio on the translated task in the working folder. All searches have ended when it returns.

    :param started: the start of the run (monotonic, s).
    :param ends: the deadline (monotonic, s).
    """
    waiting = list(work.searches)
    running: dict[int, _Running] = {}
    plans: list[tuple[str, str, float]] = []
    failures: list[str] = []
    impossible = False
    cores = max(1, len(os.sched_getaffinity(0)) - int(os.getloadavg()[0]))  # idle ones
    with resources.as_file(resources.files("up_fast_downward").joinpath(_PROGRAM)) as program:
        try:
            while (waiting or running) and not impossible and time.monotonic() < ends:
                while waiting and len(running) < cores:
                    new = _Running(waiting.pop(0), program, first=len(waiting) == len(work.searches) - 1)
                    running[new.descriptor] = new
                for descriptor in _ended(running, ends):
                    done = running.pop(descriptor)
                    code, text = done.close()
                    if text:
                        seconds = time.monotonic() - started
                        if not plans and work.grace_share is not None:
                            ends = min(ends, time.monotonic() + max(MIN_GRACE_PERIOD, work.grace_share * seconds))
                        plans.append((done.search.name, text, seconds))
                    elif code in _PROVEN:
                        impossible = not plans
                    else:
                        failures.append(f"{done.search.name} {_describe(code)}")
        finally:
            for remaining in running.values():
                remaining.kill()
    return Found(tuple(plans), impossible, bool(running or waiting), tuple(failures))


class _Running:
    """A running search."""

    def __init__(self, search: Search, program: Path, first: bool) -> None:
        """
        :param first: gives this search priority over the others.
        """
        self.search = search
        self._plan_file = Path(f"{search.name}.plan")
        arguments = [str(program), "--internal-plan-file", str(self._plan_file), "--search", search.expression]
        with open(_SAS_FILE, "rb") as task:
            self._process = subprocess.Popen(arguments, stdin=task)
        if not first:
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS)
        self.descriptor = os.pidfd_open(self._process.pid)

    def close(self) -> tuple[int, str]:
        """Returns the exit code, and the text of the plan or "", after the search has ended."""
        os.close(self.descriptor)
        code = self._process.wait()
        # A plan without its last line, the cost, is incomplete.
        text = self._plan_file.read_text() if self._plan_file.exists() else ""
        return code, text if "; cost = " in text else ""

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self.descriptor)


def _ended(running: dict[int, _Running], ends: float) -> Iterator[int]:
    """Waits until a search has ended or the deadline has passed. Yields the descriptors of ended searches."""
    poll = select.poll()
    for descriptor in running:
        poll.register(descriptor, select.POLLIN)
    seconds = max(0.0, ends - time.monotonic())
    for descriptor, _ in poll.poll(seconds * 1000):
        yield descriptor


def _describe(code: int) -> str:
    if code == _EXPLORED_INCOMPLETELY:
        return "found no plan, without a proof that there is none"
    if code in _OUT_OF_MEMORY:
        return "exceeded its memory limit"
    if code in _OUT_OF_TIME:
        return "ran out of time"
    return f"ended with code {code}"


def read_plan(text: str) -> Iterator[Sequence[str]]:
    """Yields the names of the action and objects of each step in a plan's text."""
    for line in text.splitlines():
        if line.startswith("("):
            yield line.strip("() ").split()
