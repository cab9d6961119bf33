"""Optimisers beside each other on known functions: the regret of what they report as the best.

A part of `make bench-learning`; alone: `.venv/bin/python3 tests/benchmarks/learning.py --parts optimisers`. All start
from the same ten configurations and meet the same noise, seed by seed. With a prior, the sampler draws its own ones.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import time
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, NSGAIISampler, RandomSampler, TPESampler
from optuna.trial import BaseTrial, FixedTrial
from scipy.stats import wilcoxon
from threadpoolctl import threadpool_limits

from skiros2_learning.core.prior_sampler import Normal, PriorSampler
from support import known_functions as known

Row = dict[str, Any]
#: Function, optimiser and seed.
Cell = tuple[str, str, int]
EVALUATIONS, INITIAL = 50, 10
#: Standard deviation of the priors, relative to the ranges. A good one is off by half of it in each variable.
_SPREAD = 0.1
#: The sampler that others are compared with, and those that take up to a second for a suggestion.
OURS, SLOW = "prior", ("BoTorch", "SMAC")


@dataclass(frozen=True)
class Known:
    """A function with a known minimum, or with two objectives.

    :param noise: standard deviation of what is added to each value.
    :param dimensions: with low, high and best of each variable, for priors; without them there are none.
    :param mixed: whether some variables are not real.
    :param corner: of the hypervolume, for two objectives.
    """

    name: str
    function: Callable[[BaseTrial], Any]
    minimum: float = 0.0
    noise: float = 0.0
    dimensions: int = 0
    low: float = 0.0
    high: float = 0.0
    best: float = 0.0
    mixed: bool = False
    corner: tuple[float, float] | None = None


FUNCTIONS = {
    each.name: each
    for each in (
        Known("Ackley-5", known.ackley, dimensions=5, low=-10.0, high=15.0, best=0.0),
        Known("Levy-4", known.levy, dimensions=4, low=-10.0, high=10.0, best=1.0),
        Known("Rosenbrock-3", known.rosenbrock, dimensions=3, low=-5.0, high=10.0, best=1.0),
        Known("mixed", known.mixed, mixed=True),
        Known("pressure vessel", known.pressure_vessel, known.PRESSURE_VESSEL_MINIMUM, mixed=True),
        Known("Levy-4, noise 5", known.levy, noise=5.0),
        Known("Hartmann-6, noise 0.3", known.hartmann, known.HARTMANN_MINIMUM, noise=0.3),
        Known("mixed, noise 0.1", known.mixed, noise=0.1, mixed=True),
        Known("ZDT2", known.zdt2, corner=(1.1, 5.0)),
        Known("DTLZ2", known.dtlz2, corner=(2.0, 2.0)),
        Known("BraninCurrin", known.branin_currin, corner=(150.0, 14.0)),
    )
}


def _samplers(function: Known) -> dict[str, Callable[[int], BaseSampler]]:
    """The optimisers that are installed, by name."""
    found: dict[str, Callable[[int], BaseSampler]] = {
        "random": lambda seed: RandomSampler(seed=seed),
        "TPE": lambda seed: TPESampler(n_startup_trials=INITIAL, multivariate=True, seed=seed),
    }
    if function.corner:
        found["NSGA-II"] = lambda seed: NSGAIISampler(population_size=INITIAL, seed=seed)
    elif not function.mixed and find_spec("cmaes"):
        found["CMA-ES"] = lambda seed: CmaEsSampler(n_startup_trials=INITIAL, seed=seed)
    if find_spec("torch"):
        found["Optuna's GP"] = lambda seed: GPSampler(
            n_startup_trials=INITIAL, seed=seed, deterministic_objective=not function.noise
        )
    for name in (OURS, *(each for each in SLOW if find_spec(each.lower()))):
        found[name] = lambda seed, name=name: _with_priors(name)(n_startup_trials=INITIAL, seed=seed)  # type: ignore[misc]
        for kind in ("good", "wrong") if function.dimensions else ():
            found[f"{name}, {kind} prior"] = lambda seed, name=name, kind=kind: _with_priors(name)(  # type: ignore[misc]
                _prior(function, kind), n_startup_trials=INITIAL, beta=EVALUATIONS / 10, seed=seed
            )
    return found


def _with_priors(name: str) -> type[PriorSampler]:
    """The sampler of that name, whose library is imported only now: it takes seconds."""
    if name == "BoTorch":
        from skiros2_learning.core.botorch_sampler import BoTorchSampler

        return BoTorchSampler
    if name == "SMAC":
        from skiros2_learning.core.smac_sampler import SmacSampler

        return SmacSampler
    return PriorSampler


def _prior(function: Known, kind: str) -> dict[str, Normal]:
    """A good prior is off by half of its deviation; the mean of a wrong one is at the far end of each range."""
    width = function.high - function.low
    far = function.low if function.best - function.low > width / 2.0 else function.high
    inside = far + math.copysign(_SPREAD * width, function.best - far)
    mean = function.best + _SPREAD * width / 2.0 if kind == "good" else inside
    return {f"x{i}": Normal(mean, _SPREAD * width) for i in range(function.dimensions)}


def optimisers(file: Path, seeds: int, show: Callable[[Row], Row], only: str = "") -> list[Row]:
    """Measures the cells that `file` does not have yet, all optimisers with few seeds first, and prints its table.

    :param file: a line of JSON for each function, optimiser and seed, written as soon as it is measured.
    :param only: names of optimisers, separated by |; "" for all, the slow ones with a third of the seeds.
    """
    names = only.split("|")
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    there = {(row["function"], row["optimiser"], row["seed"]) for row in rows}
    cells = [
        (function.name, name, seed)
        for function in FUNCTIONS.values()
        for name in _samplers(function)
        for seed in range(1, (seeds // 3 if name.startswith(SLOW) and not only else seeds) + 1)
        if not only or name in names
    ]
    cells.sort(key=lambda cell: cell[2] * (2 if cell[1].startswith(SLOW) else 1))
    file.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool, file.open("a") as lines:
        for future in as_completed([pool.submit(measured, cell) for cell in cells if cell not in there]):
            rows.append(show(future.result()))
            print(json.dumps(rows[-1]), file=lines, flush=True)
    print(table(rows))
    return rows


def table(rows: Iterable[Row]) -> str:
    """Returns a table in Markdown of medians with quartiles. A star: differs from ours (p < 0.05, signed-rank test)."""
    found: dict[tuple[str, str], dict[int, float]] = {}
    spent: dict[str, list[float]] = {}
    for row in rows:
        found.setdefault((row["function"], row["optimiser"]), {})[row["seed"]] = row["value"]
        spent.setdefault(row["optimiser"], []).append(row["seconds"])
    names = sorted(spent, key=lambda name: (OURS in name, name.startswith(SLOW), name != "random"))
    lines = ["| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for function in FUNCTIONS:
        ours = found.get((function, OURS), {})
        cells = [_shown(found.get((function, name), {}), ours) for name in names]
        lines.append(f"| {function} | " + " | ".join(cells) + " |")
    seconds = (f"{statistics.median(spent[name]):.2g} to {max(spent[name]):.2g}" for name in names)
    return "\n".join([*lines, "| s per suggestion | " + " | ".join(seconds) + " |"])


def _shown(values: dict[int, float], ours: dict[int, float]) -> str:
    if len(values) < 2:
        return "–"
    low, middle, high = statistics.quantiles(values.values(), n=4, method="inclusive")
    apart = [values[seed] - ours[seed] for seed in values if seed in ours]
    star = "*" if any(apart) and wilcoxon(apart).pvalue < 0.05 else ""
    few = f" ({len(values)} seeds)" if len(values) < len(ours) else ""
    return f"{middle:.3g}{star} [{low:.3g}, {high:.3g}]{few}"


def measured(cell: Cell) -> Row:
    """Returns regret or hypervolume of what an optimiser reports, and its CPU time for a suggestion (s).

    With noise the configuration that is reported has the best mean of the same model for all optimisers; otherwise it
    has the best value. Its true value counts.
    """
    problem, optimiser, seed = cell
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    function = FUNCTIONS[problem]
    last: list[float] = []
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        study = optuna.create_study(
            directions=["minimize"] * (2 if function.corner else 1), sampler=_samplers(function)[optimiser](seed)
        )
        if not optimiser.endswith(" prior"):
            _enqueue(study, function, seed)
        for number in range(EVALUATIONS):
            begin = time.process_time()
            trial = study.ask()
            value = function.function(trial)
            last.append(time.process_time() - begin)
            if function.noise:
                value += function.noise * float(np.random.default_rng([seed, number]).normal())
            study.tell(trial, value)
        row = {"function": problem, "optimiser": optimiser, "seed": seed, "value": _value(study, function)}
    return {**row, "seconds": statistics.fmean(last[INITIAL:])}


def _enqueue(study: optuna.Study, function: Known, seed: int) -> None:
    """Gives a study its first configurations, which depend on the seed only."""
    drawn = optuna.create_study(directions=study.directions, sampler=RandomSampler(seed=1000 + seed))
    drawn.optimize(function.function, n_trials=INITIAL)
    for each in drawn.trials:
        study.enqueue_trial(each.params)


def _value(study: optuna.Study, function: Known) -> float:
    if function.corner:
        return known.dominated_area([tuple(each.values) for each in study.best_trials], function.corner)
    best = PriorSampler(seed=0).recommended(study) if function.noise else study.best_trial
    return float(function.function(FixedTrial(best.params))) - function.minimum
