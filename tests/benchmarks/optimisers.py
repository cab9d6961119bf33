"""Optimisers beside each other on known functions: the regret of what they report as the best.

A part of `make bench-learning`; alone: `.venv/bin/python3 tests/benchmarks/learning.py --parts optimisers`. All start
from the same ten configurations and meet the same noise, seed by seed. With a prior, the sampler draws its own ones.
"""

from __future__ import annotations

import math
import os
import statistics
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import optuna
from optuna.exceptions import ExperimentalWarning
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, NSGAIISampler, RandomSampler, TPESampler
from optuna.trial import BaseTrial, FixedTrial, Trial
from threadpoolctl import threadpool_limits

from skiros2_learning.core.prior_sampler import Normal, PriorSampler
from support import known_functions as known

Row = dict[str, Any]
EVALUATIONS, INITIAL = 50, 10
#: Standard deviation of the priors, relative to the ranges. A good one is off by half of it in each variable.
_SPREAD = 0.1


@dataclass(frozen=True)
class Known:
    """A function with a known minimum of 0.

    :param noise: standard deviation of what is added to each value.
    :param low, high, best: of each variable, for priors; without them there are none.
    """

    name: str
    function: Callable[[BaseTrial], float]
    noise: float = 0.0
    dimensions: int = 0
    low: float = 0.0
    high: float = 0.0
    best: float = 0.0


FUNCTIONS = {
    each.name: each
    for each in (
        Known("Ackley-5", known.ackley, dimensions=5, low=-10.0, high=15.0, best=0.0),
        Known("Levy-4", known.levy, dimensions=4, low=-10.0, high=10.0, best=1.0),
        Known("Rosenbrock-3", known.rosenbrock, dimensions=3, low=-5.0, high=10.0, best=1.0),
        Known("mixed", known.mixed),
        Known("Levy-4, noise 5", known.levy, noise=5.0),
    )
}
#: Two objectives, and the corner of the hypervolume.
FRONTS = {
    "ZDT2": (known.zdt2, (1.1, 5.0)),
    "DTLZ2": (known.dtlz2, (2.0, 2.0)),
    "BraninCurrin": (known.branin_currin, (150.0, 14.0)),
}


def _samplers(known_one: Known | None) -> dict[str, Callable[[int], BaseSampler]]:
    """The optimisers that are installed, by name."""
    found: dict[str, Callable[[int], BaseSampler]] = {
        "random": lambda seed: RandomSampler(seed=seed),
        "TPE": lambda seed: TPESampler(n_startup_trials=INITIAL, multivariate=True, seed=seed),
    }
    if known_one is None:
        found["NSGA-II"] = lambda seed: NSGAIISampler(population_size=INITIAL, seed=seed)
    elif known_one.name != "mixed" and find_spec("cmaes"):
        found["CMA-ES"] = lambda seed: CmaEsSampler(n_startup_trials=INITIAL, seed=seed)
    if find_spec("torch"):
        noise = known_one is not None and known_one.noise > 0.0
        found["Optuna's GP"] = lambda seed: GPSampler(
            n_startup_trials=INITIAL, seed=seed, deterministic_objective=not noise
        )
    for name in ("ours", *(each for each in ("BoTorch", "SMAC") if find_spec(each.lower()))):
        found[name] = lambda seed, name=name: _with_priors(name)(n_startup_trials=INITIAL, seed=seed)  # type: ignore[misc]
        for kind in ("good", "wrong") if known_one is not None and known_one.dimensions else ():
            found[f"{name}, {kind} prior"] = lambda seed, name=name, kind=kind: _with_priors(name)(  # type: ignore[misc]
                _prior(known_one, kind), n_startup_trials=INITIAL, beta=EVALUATIONS / 10, seed=seed
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


def optimisers(seeds: Sequence[int], show: Callable[[Row], Row], only: str = "") -> list[Row]:
    """Medians of the regret after 50 evaluations with their quartiles, and of the hypervolume; time per suggestion.

    :param only: names of optimisers, separated by |; "" for all.
    """
    wanted = only.split("|") if only else None
    rows = []
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        for run, problem, name in _cases():
            if wanted is not None and name not in wanted:
                continue
            found = list(pool.map(run, [problem] * len(seeds), [name] * len(seeds), seeds))
            values = [value for value, _ in found]
            low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
            row = {"function": problem, "optimiser": name, "median": middle, "quartiles": f"{low:.3g} to {high:.3g}"}
            rows.append(show({**row, "s per suggestion": statistics.median(spent for _, spent in found)}))
    return rows


def _cases() -> Iterator[tuple[Callable[[str, str, int], tuple[float, float]], str, str]]:
    for name, function in FUNCTIONS.items():
        yield from ((regret, name, each) for each in _samplers(function))
    for name in FRONTS:
        yield from ((hypervolume, name, each) for each in _samplers(None))


def regret(problem: str, optimiser: str, seed: int) -> tuple[float, float]:
    """Returns the true value of the reported configuration less the minimum, and the time of a suggestion (s)."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    function = FUNCTIONS[problem]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        sampler = _samplers(function)[optimiser](seed)
    study = optuna.create_study(sampler=sampler)
    if "prior" not in optimiser:
        drawn = optuna.create_study(sampler=RandomSampler(seed=1000 + seed))
        drawn.optimize(function.function, n_trials=INITIAL)
        for each in drawn.trials:
            study.enqueue_trial(each.params)

    def noisy(trial: Trial) -> float:
        luck = float(np.random.default_rng([seed, trial.number]).normal())
        return function.function(trial) + function.noise * luck

    spent = _run(study, noisy)
    report = getattr(sampler, "recommended", lambda each: each.best_trial)
    return function.function(FixedTrial(report(study).params)), spent


def hypervolume(problem: str, optimiser: str, seed: int) -> tuple[float, float]:
    """Returns the hypervolume that the evaluations dominate, and the time of a suggestion (s)."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    function, corner = FRONTS[problem]
    study = optuna.create_study(directions=["minimize", "minimize"], sampler=_samplers(None)[optimiser](seed))
    spent = _run(study, function)
    return known.dominated_area([tuple(each.values) for each in study.best_trials], corner), spent


def _run(study: optuna.Study, function: Callable[[Trial], Any]) -> float:
    last: list[float] = []
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        for _ in range(EVALUATIONS):
            begin = time.thread_time()
            trial = study.ask()
            value = function(trial)
            last.append(time.thread_time() - begin)
            study.tell(trial, value)
    return statistics.fmean(last[INITIAL:])
