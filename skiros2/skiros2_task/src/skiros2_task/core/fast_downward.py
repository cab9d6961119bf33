"""Searches of Fast Downward side by side, on one translation of a task.

Translating takes as long as searching, so it is done once for all of them, and in the process that has the translator
loaded already. To be used in a process of its own (see `engine_worker`), as the translator keeps its options in a
module and a run may be ended at any time.
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

TRANSLATOR = "fast_downward.translate.main"
_NICENESS = 19  # of all searches but the first
_PROGRAM = "downward/builds/release/bin/downward"
_SAS_FILE = "output.sas"

# What its exit codes mean: https://www.fast-downward.org/latest/documentation/exit-codes
_PROVEN = (10, 11)
_EXPLORED_INCOMPLETELY = 12
_OUT_OF_MEMORY = (20, 22, 24)
_OUT_OF_TIME = (21, 23)


@dataclass(frozen=True)
class Search:
    """A way to search.

    :param name: what it is called in logs.
    :param expression: what stands behind Fast Downward's `--search`.
    """

    name: str
    expression: str


@dataclass(frozen=True)
class SideBySide:
    """Searches to run at once, as many as there are free cores; the others follow in their order.

    :param searches: the most promising first.
    :param patience: how long to go on after the first plan, as a share of the time until then; None: until all have
        ended. At least `MIN_PATIENCE`.
    :param goal_action: the goal becomes the pre-condition of a last action, for searches that take no alternatives in
        goals.
    """

    searches: tuple[Search, ...]
    patience: float | None = None
    goal_action: bool = False


MIN_PATIENCE = 0.15  # s

LAMA_FIRST = Search(
    "lama-first",
    "let(hlm, eval_modify_costs(landmark_sum(lm_factory=lm_reasonable_orders_hps(lm_rhw()),pref=false),cost_type=one),"
    "let(hff, eval_modify_costs(ff(),cost_type=one),"
    "lazy_greedy([hff,hlm],preferred=[hff,hlm],cost_type=one,reopen_closed=false)))",
)
LAZY_WASTAR = Search("lazy-wastar-2", "let(hff, ff(), lazy_wastar([hff],preferred=[hff],w=2))")
LAZY_GREEDY = Search("lazy-greedy-ff", "let(hff, ff(), lazy_greedy([hff],preferred=[hff]))")
OPTIMAL = Search("astar-lmcut", "astar(lmcut())")


def shuffled(seed: int) -> Search:
    """Lazy WA* that looks at successors in a random order, always the same for a seed."""
    options = f"preferred=[hff],w=2,randomize_successors=true,random_seed={seed}"
    return Search(f"lazy-wastar-2-seed-{seed}", f"let(hff, ff(), lazy_wastar([hff],{options}))")


@dataclass(frozen=True)
class Found:
    """What searches gave.

    :param plans: the name of a search, its plan as text, and after how many seconds it was there; in that order.
    :param impossible: one has proven that there is no plan.
    :param out_of_time: some had not ended.
    :param failures: how the others ended without a plan, in words.
    """

    plans: tuple[tuple[str, str, float], ...]
    impossible: bool = False
    out_of_time: bool = False
    failures: tuple[str, ...] = ()


def translate(domain: str, problem: str) -> None:
    """Writes the translated task to the working folder. The translator's errors come as they are."""
    options = importlib.import_module("fast_downward.translate.options")
    options.set_options([domain, problem, "--sas-file", _SAS_FILE])
    importlib.import_module(TRANSLATOR).main()


def search(work: SideBySide, started: float, ends: float) -> Found:
    """Runs searches on the translated task in the working folder. None of them is left running.

    :param started: when the run of which this is a part began (monotonic, s).
    :param ends: when it has to be over.
    """
    waiting = list(work.searches)
    running: dict[int, _Running] = {}
    plans: list[tuple[str, str, float]] = []
    failures: list[str] = []
    impossible = False
    cores = max(1, len(os.sched_getaffinity(0)) - int(os.getloadavg()[0]))  # that others leave free
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
                        if not plans and work.patience is not None:
                            ends = min(ends, time.monotonic() + max(MIN_PATIENCE, work.patience * seconds))
                        plans.append((done.search.name, text, seconds))
                    elif code in _PROVEN:
                        impossible = not plans
                    else:
                        failures.append(f"{done.search.name} {_meaning(code)}")
        finally:
            for left in running.values():
                left.end()
    return Found(tuple(plans), impossible, bool(running or waiting), tuple(failures))


class _Running:
    """A search that runs."""

    def __init__(self, what: Search, program: Path, first: bool) -> None:
        """
        :param first: the one that gets the processor where there is not enough for all.
        """
        self.search = what
        self._plan_file = Path(f"{what.name}.plan")
        arguments = [str(program), "--internal-plan-file", str(self._plan_file), "--search", what.expression]
        with open(_SAS_FILE, "rb") as task:
            self._process = subprocess.Popen(arguments, stdin=task)
        if not first:
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICENESS)
        self.descriptor = os.pidfd_open(self._process.pid)

    def close(self) -> tuple[int, str]:
        """The exit code, and the plan's text or "", of one that has ended."""
        os.close(self.descriptor)
        code = self._process.wait()
        # Without its last line, the cost, a plan is not whole.
        text = self._plan_file.read_text() if self._plan_file.exists() else ""
        return code, text if "; cost = " in text else ""

    def end(self) -> None:
        """Kills it."""
        self._process.kill()
        self._process.wait()
        os.close(self.descriptor)


def _ended(running: dict[int, _Running], ends: float) -> Iterator[int]:
    """Waits until some have ended, or time is over."""
    poll = select.poll()
    for descriptor in running:
        poll.register(descriptor, select.POLLIN)
    seconds = max(0.0, ends - time.monotonic())
    for descriptor, _ in poll.poll(seconds * 1000):
        yield descriptor


def _meaning(code: int) -> str:
    if code == _EXPLORED_INCOMPLETELY:
        return "found no plan, and does not prove that there is none"
    if code in _OUT_OF_MEMORY:
        return "needs more memory than it may use"
    if code in _OUT_OF_TIME:
        return "ran out of time"
    return f"ended with code {code}"


def read_plan(text: str) -> Iterator[Sequence[str]]:
    """The steps of a plan's text, each the names of its action and objects."""
    for line in text.splitlines():
        if line.startswith("("):
            yield line.strip("() ").split()
