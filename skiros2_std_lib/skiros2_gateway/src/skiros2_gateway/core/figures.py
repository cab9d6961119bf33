"""Keeps the figures of robots by the hour: they survive restarts, and can be had for a period.

Kinds of figures: `seconds` by state, `tasks` by outcome (succeeded, failed); and of tasks by the label of their skill:
`runs`, `run_seconds` and `failures`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
import weakref
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from skiros2_gateway.core.problems import StoreFailed
from skiros2_gateway.core.store import FigureKey, JobStore
from skiros2_live.core.cell import CellDocument, RunsLost
from skiros2_live.core.robots import Totals
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import Recorded, TaskRun

log = logging.getLogger(__name__)

#: How often figures are written (s), and when a task ends; a kill of the gateway loses the states of this time.
PERIOD = 1.0
_HOUR = 3600.0  # s
_HAS_FAILED = "outcome NOT IN ('succeeded', 'nothing_to_do', 'cancelled')"
_HAS_SUCCEEDED = "outcome IN ('succeeded', 'nothing_to_do')"
_FAILED = (TaskState.FAILED, TaskState.LOST)
_OF_SKILLS, _NOTHING = ("runs", "run_seconds", "failures"), (0.0, 0.0, 0.0)
_MAX_FAILURES = 20
#: The most points of a figure over time.
_MAX_POINTS = 60


class Figures:
    """Writes what robots of a document have done since the last time. To be used in the thread of the document."""

    def __init__(self, store: JobStore, document: CellDocument) -> None:
        self._store = store
        self._document = document
        self._ended: defaultdict[FigureKey, float] = defaultdict(float)
        self._has_ended = asyncio.Event()
        self._final: weakref.WeakSet[TaskRun] = weakref.WeakSet()
        #: What was counted of lost tasks, which may return: runs, seconds and failures.
        self._lost: weakref.WeakKeyDictionary[TaskRun, tuple[float, ...]] = weakref.WeakKeyDictionary()
        self._written: dict[str, Totals] = totals_of(store.figures())
        document.subscribe(Recorded, lambda recorded: self._count([recorded.run]))
        document.subscribe(RunsLost, lambda change: self._count(change.runs))

    def write(self) -> None:
        """Writes what is new.

        :raises StoreFailed: it is written the next time.
        """
        new = {name: robot.totals() for name, robot in self._document.robots.items()}
        values = dict(self._ended)
        for name, totals in new.items():
            written = _figures(name, self._written.get(name, Totals()))
            values |= {key: value - written.get(key, 0.0) for key, value in _figures(name, totals).items()}
        self._store.add_figures(int(self._document.clock() // _HOUR), {k: v for k, v in values.items() if v})
        self._written.update(new)
        self._ended.clear()

    async def keep(self) -> None:
        """Writes each `PERIOD`, after the end of a task and at the end, until it is cancelled."""
        try:
            while True:
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self._has_ended.wait(), PERIOD)
                self._has_ended.clear()
                self._try_write()
        finally:
            self._try_write()

    def _try_write(self) -> None:
        try:
            self.write()
        except StoreFailed as error:
            log.error("the figures of robots are written later: %s", error)

    def _count(self, runs: Iterable[TaskRun]) -> None:
        for run in runs:
            if run.robot == GOALS or run in self._final or not (run.is_finished or run in self._lost):
                continue
            self._has_ended.set()
            before, now = self._lost.pop(run, _NOTHING), _NOTHING
            if run.is_finished:
                now = (1.0, run.latest.time - run.start, float(run.state in _FAILED))
                if run.latest.has_ended:
                    self._final.add(run)
                else:
                    self._lost[run] = now
            skill = run.nodes[1 if len(run.nodes) > 1 else 0].label
            for kind, old, new in zip(_OF_SKILLS, before, now, strict=True):
                self._ended[FigureKey(run.robot, kind, skill)] += new - old


def totals_of(figures: Mapping[FigureKey, float]) -> dict[str, Totals]:
    """Returns the totals of each robot, by its name."""
    times: defaultdict[str, dict[str, float]] = defaultdict(dict)
    counts: Counter[tuple[str, str]] = Counter()
    for key, value in figures.items():
        if key.kind == "seconds":
            times[key.robot][key.name] = value
        elif key.kind == "tasks":
            counts[key.robot, key.name] = max(0, round(value))  # the loss may have been before the period
    names = {*times, *(robot for robot, _ in counts)}
    return {name: Totals(times[name], counts[name, "succeeded"], counts[name, "failed"]) for name in names}


def _figures(robot: str, totals: Totals) -> dict[FigureKey, float]:
    seconds = {FigureKey(robot, "seconds", state): value for state, value in totals.times.items()}
    tasks = {"succeeded": totals.succeeded, "failed": totals.failed}
    return seconds | {FigureKey(robot, "tasks", name): value for name, value in tasks.items()}


def report(store: JobStore, begin: float, end: float) -> dict[str, Any]:
    """Returns the figures of a period as JSON data; see `GET /api/figures`.

    :param begin, end: s since the epoch; the figures of robots are those of all hours that the period touches.
    """
    first, last = int(begin // _HOUR), int(-(-end // _HOUR))
    figures, since = store.figures(first, last), store.first_hours()
    robots = []
    for name, totals in sorted(totals_of(figures).items()):
        counters = totals.counters()
        period = min(last * _HOUR, time.time()) - max(first, since.get(name, first)) * _HOUR
        robots.append({"robot": name, **counters, "unknown_s": max(0.0, period - counters["total_s"])})
    skills = [
        {
            "robot": key.robot,
            "skill": key.name,
            "runs": round(runs),
            "failures": round(figures.get(key._replace(kind="failures"), 0.0)),
            "mean_s": figures.get(key._replace(kind="run_seconds"), 0.0) / runs,
        }
        for key, runs in sorted(figures.items())
        if key.kind == "runs" and runs > 0.0
    ]
    jobs = [{"outcome": outcome, "jobs": count} for outcome, count in store.count_ended(begin, end, "outcome")]
    found = store.count_ended(begin, end, "json_extract(document, '$.response.message')", _HAS_FAILED)
    failures = [{"message": message, "jobs": count} for message, count in found[:_MAX_FAILURES]]
    tables = {"robots": robots, "skills": skills, "jobs": jobs, "failures": failures}
    return {"begin": begin, "end": end, **tables, **_over_time(store, begin, end)}


def _over_time(store: JobStore, begin: float, end: float) -> dict[str, Any]:
    """Returns the figures over time: `step` (s) of their points, `throughput` and `durations`."""
    hours = int(begin // _HOUR), int(-(-end // _HOUR))
    durations = [each for each in store.figures_by_hour(*hours) if each[1] in ("runs", "run_seconds")]
    ended = store.count_ended(begin, end, f"CAST(ended / {_HOUR} AS INTEGER)")
    first = max(hours[0], min((hour for hour, *_ in (*durations, *ended)), default=hours[1]))
    step = max(1, -(-(hours[1] - first) // _MAX_POINTS))  # hours
    key = f"CAST(ended / {step * _HOUR} AS INTEGER)"
    good, bad = (dict(store.count_ended(begin, end, key, where)) for where in (_HAS_SUCCEEDED, _HAS_FAILED))
    points = range(first // step, -(-hours[1] // step))
    sums: defaultdict[tuple[int, str], Counter[str]] = defaultdict(Counter)
    for hour, kind, name, value in durations:
        sums[hour // step, name][kind] += value  # type: ignore[assignment]
    width = step * _HOUR
    return {
        "step": width,
        "throughput": [
            {"begin": each * width, "succeeded": good.get(each, 0), "failed": bad.get(each, 0)} for each in points
        ],
        "durations": [
            {"begin": point * width, "skill": skill, "runs": round(sums[point, skill]["runs"]),
             "mean_s": sums[point, skill]["run_seconds"] / sums[point, skill]["runs"]}
            for point, skill in sorted(sums) if sums[point, skill]["runs"] > 0
        ],
    }  # fmt: skip
