"""A sampler for Optuna: Bayesian optimisation that is guided by priors, for one or several objectives.

It needs Optuna, NumPy, SciPy and scikit-learn, nothing else of this project:

    sampler = PriorSampler({"x": Normal(0.2, 0.05), "gait": Choice({"walk": 3, "trot": 1})}, seed=1)
    study = optuna.create_study(sampler=sampler)

What it combines:

- Variables may be real, integer, ordinal (categorical with numbers only) and categorical.
- The first trials are drawn from the prior. Then a surrogate is fitted: a Gaussian process (Matérn 5/2, one length
  scale for each variable), or a random forest with many observations or with categorical variables.
- The next trial maximises the expected improvement, multiplied by the prior to the power of beta/n after n trials
  (Hvarfner et al., "πBO: Augmenting Acquisition Functions with User Beliefs for Bayesian Optimization", ICLR 2022): a
  good prior helps early, a misleading one is forgotten.
- Several objectives are scalarised with random weights in each trial by the augmented Chebyshev function (Knowles,
  "ParEGO", 2006; Paria et al., "A Flexible Framework for Multi-Objective Bayesian Optimization using Random
  Scalarizations", 2019).
- With constraints (`trial.set_constraint`) the acquisition is multiplied by the probability of
  feasibility (Gardner et al., "Bayesian Optimization with Inequality Constraints", 2014), by a random forest.
- Running trials count with the worst value, so that parallel trials differ.

The random numbers of a trial depend on the seed and the number of the trial: a study that is resumed continues as it
would have, if its trials end in the same order.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.samplers import BaseSampler
from optuna.search_space import IntersectionSearchSpace
from optuna.study import Study, StudyDirection
from optuna.trial import FrozenTrial, TrialState
from scipy.stats import norm
from sklearn.ensemble import RandomForestClassifier, RandomForestRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
from threadpoolctl import threadpool_limits

Array = npt.NDArray[np.float64]

#: Observations up to which a Gaussian process is fitted: its time grows with their third power.
MAX_GAUSSIAN_PROCESS = 120
#: Candidates of a trial, and how many of the best ones are refined.
_CANDIDATES, _REFINED, _AROUND = 1500, 5, 60
_TREES = 30
#: Smallest density, relative to the greatest one: no value is impossible.
_LEAST_DENSITY = 1e-12
#: Weight of the sum in the augmented Chebyshev function.
_AUGMENTATION = 0.05


class Prior(Protocol):
    """A belief about good values of one variable."""

    def log_density(self, value: Any) -> float:
        """Returns the logarithm of the density of a value, up to a constant."""
        ...


@dataclass(frozen=True)
class Normal:
    """A normal prior, truncated to the range of the variable."""

    mean: float
    std: float

    def log_density(self, value: Any) -> float:
        return -0.5 * ((float(value) - self.mean) / self.std) ** 2


@dataclass(frozen=True)
class Choice:
    """A prior of a categorical or ordinal variable.

    :param weights: by value; 0 for a value that is not there.
    """

    weights: Mapping[Any, float]

    def log_density(self, value: Any) -> float:
        return math.log(max(self.weights.get(value, 0.0), _LEAST_DENSITY))


class PriorSampler(BaseSampler):
    """See the module.

    :param priors: by name of the variable; others are uniform.
    :param n_startup_trials: trials that are drawn from the prior.
    :param beta: strength of the prior; a tenth of the number of trials is a good value.
    :param surrogate: "auto" selects by number of observations and types of variables.
    :param seed: of all random numbers; None for another one each time.
    """

    def __init__(
        self,
        priors: Mapping[str, Prior] | None = None,
        *,
        n_startup_trials: int = 10,
        beta: float = 10.0,
        surrogate: Literal["auto", "gp", "forest"] = "auto",
        seed: int | None = None,
    ) -> None:
        self._priors = dict(priors or {})
        self._startup = n_startup_trials
        self._beta = beta
        self._surrogate = surrogate
        self._seed = int(np.random.default_rng(seed).integers(2**31))
        self._space = IntersectionSearchSpace(include_pruned=True)

    def reseed_rng(self) -> None:
        """Does nothing: random numbers depend on the number of the trial."""

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        found = self._space.calculate(study)
        return {name: distribution for name, distribution in found.items() if not distribution.single()}

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        random = np.random.default_rng([self._seed, trial.number, *param_name.encode()])
        space = _Space({param_name: param_distribution}, self._priors)
        return space.values(space.from_prior(1, random)[0])[param_name]

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        if not search_space:
            return {}
        trials = [
            each
            for each in study.get_trials(deepcopy=False)
            if each.number != trial.number and set(search_space) <= set(each.params)
        ]
        complete = [each for each in trials if each.state is TrialState.COMPLETE]
        random = np.random.default_rng([self._seed, trial.number])
        space = _Space(search_space, self._priors)
        if trial.number < self._startup or len(complete) < 2:
            return space.values(space.from_prior(1, random)[0])
        ended = [each for each in trials if each.state.is_finished()]
        running = [each for each in trials if each.state is TrialState.RUNNING]
        with threadpool_limits(1):  # the matrices are small: threads would cost more than they bring
            acquisition = self._acquisition(space, study, complete, ended, running, random)
            return space.values(_maximise(space, acquisition, complete, random))

    def _acquisition(
        self,
        space: _Space,
        study: Study,
        complete: Sequence[FrozenTrial],
        ended: Sequence[FrozenTrial],
        running: Sequence[FrozenTrial],
        random: np.random.Generator,
    ) -> _Acquisition:
        observed = space.points(complete)
        values = _scalarised(study.directions, complete, random)
        feasible = np.array([all(value <= 0.0 for value in each.constraints.values()) for each in complete])
        model: _Model | None = None
        best = 0.0
        if feasible.any():
            best = float(values[feasible].min())
            points = np.vstack([observed, space.points(running)]) if running else observed
            known = np.concatenate([values, np.full(len(running), values.max())])
            model = self._fit(space, points, known, random)
        limits = [
            self._fit(space, observed, np.array([each.constraints[name] for each in complete]), random)
            for name in sorted(set.intersection(*(set(each.constraints) for each in complete)))
        ]
        tried = [each for each in ended if each.state in (TrialState.COMPLETE, TrialState.FAIL)]
        classifier = None
        if len(tried) > len(complete):
            classifier = RandomForestClassifier(_TREES, min_samples_leaf=2, random_state=int(random.integers(2**31)))
            works = [each.state is TrialState.COMPLETE for each in tried]
            classifier.fit(space.features(space.points(tried)), works)
        return _Acquisition(space, model, best, limits, classifier, self._beta / len(complete))

    def _fit(self, space: _Space, points: Array, values: Array, random: np.random.Generator) -> _Model:
        kind = self._surrogate
        if kind == "auto":
            kind = "gp" if len(points) <= MAX_GAUSSIAN_PROCESS and not space.has_nominal else "forest"
        spread = float(values.std()) or 1.0
        normal = (values - values.mean()) / spread
        seed = int(random.integers(2**31))
        features = space.features(points)
        if kind == "forest":
            forest = RandomForestRegressor(_TREES, min_samples_leaf=2, max_features=0.8, random_state=seed)
            return _Model(forest.fit(features, normal), float(values.mean()), spread)
        scales = np.full(features.shape[1], 0.5)
        matern = ConstantKernel(1.0, (0.05, 20.0)) * Matern(scales, (0.03, 10.0), nu=2.5)
        kernel = matern + WhiteKernel(1e-3, (1e-6, 1.0))
        process = GaussianProcessRegressor(kernel, n_restarts_optimizer=0, random_state=seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a length scale at its bound is no mistake
            return _Model(process.fit(features, normal), float(values.mean()), spread)


class _Space:
    """A search space as points: one number per variable, from 0 to 1; of a nominal one, the index of its value."""

    def __init__(self, distributions: Mapping[str, BaseDistribution], priors: Mapping[str, Prior]) -> None:
        self._distributions = dict(sorted(distributions.items()))
        self._priors = [priors.get(name) for name in self._distributions]
        self._nominal = [_is_nominal(distribution) for distribution in self._distributions.values()]
        self.has_nominal = any(self._nominal)
        self.dimensions = len(self._distributions)
        self._tables: dict[int, tuple[Array, Array]] = {}

    def points(self, trials: Sequence[FrozenTrial]) -> Array:
        """Returns the points of trials, shape (n, d)."""
        items = self._distributions.items()
        return np.array([[_to_unit(d, each.params[name]) for name, d in items] for each in trials]).reshape(
            len(trials), self.dimensions
        )

    def values(self, point: Array) -> dict[str, Any]:
        """Returns the values of a point by name."""
        return {name: _from_unit(d, float(x)) for (name, d), x in zip(self._distributions.items(), point, strict=True)}

    def rounded(self, points: Array) -> Array:
        """Returns the points with values that exist: integers, choices."""
        return np.column_stack(
            [_round_units(distribution, points[:, i]) for i, distribution in enumerate(self._distributions.values())]
        )

    def features(self, points: Array) -> Array:
        """Returns the inputs of the surrogate: nominal variables with one number for each value."""
        columns: list[Array] = []
        for i, distribution in enumerate(self._distributions.values()):
            if self._nominal[i]:
                count = len(distribution.choices)  # type: ignore[attr-defined]
                columns += [(points[:, i] == k).astype(float) for k in range(count)]
            else:
                columns.append(points[:, i])
        return np.column_stack(columns)

    def uniform(self, count: int, random: np.random.Generator) -> Array:
        """Draws points without the prior."""
        points = random.random((count, self.dimensions))
        for i, distribution in enumerate(self._distributions.values()):
            if self._nominal[i]:
                points[:, i] = random.integers(len(distribution.choices), size=count)  # type: ignore[attr-defined]
        return self.rounded(points)

    def from_prior(self, count: int, random: np.random.Generator) -> Array:
        """Draws points from the prior, each variable on its own, on a grid of values."""
        columns = []
        for i, distribution in enumerate(self._distributions.values()):
            prior = self._priors[i]
            if prior is None:
                columns.append(self.uniform(count, random)[:, i])
                continue
            grid, logs = self._table(i, distribution, prior)
            weights = np.exp(logs)
            drawn = random.choice(grid, size=count, p=weights / weights.sum())
            if isinstance(distribution, FloatDistribution):  # between the points of the grid
                drawn = np.clip(drawn + random.uniform(-0.5, 0.5, count) * (grid[1] - grid[0]), 0.0, 1.0)
            columns.append(drawn)
        return self.rounded(np.column_stack(columns))

    def _table(self, index: int, distribution: BaseDistribution, prior: Prior) -> tuple[Array, Array]:
        """Returns points of one variable that cover its range, and the logarithms of the density, 0 at its maximum."""
        if index not in self._tables:
            grid = _grid(distribution)
            logs = np.array([prior.log_density(_from_unit(distribution, float(x))) for x in grid])
            self._tables[index] = grid, logs - logs.max()
        return self._tables[index]

    def near(self, points: Array, count: int, spread: float, random: np.random.Generator) -> Array:
        """Draws points around given ones, `count` each."""
        centres = np.repeat(points, count, axis=0)
        moved = centres + random.normal(0.0, spread, centres.shape) * (random.random(centres.shape) < 0.7)
        for i, distribution in enumerate(self._distributions.values()):
            if self._nominal[i]:
                other = random.integers(len(distribution.choices), size=len(centres))  # type: ignore[attr-defined]
                keeps = random.random(len(centres)) > 1.0 / self.dimensions
                moved[:, i] = np.where(keeps, centres[:, i], other)
            else:
                moved[:, i] = np.clip(moved[:, i], 0.0, 1.0)
        return self.rounded(moved)

    def log_prior(self, points: Array) -> Array:
        """Returns the logarithm of the prior's density, 0 at its maximum; bounded below."""
        total = np.zeros(len(points))
        for i, distribution in enumerate(self._distributions.values()):
            prior = self._priors[i]
            if prior is None:
                continue
            grid, logs = self._table(i, distribution, prior)
            nearest = np.abs(points[:, i, None] - grid).argmin(axis=1) if _count(distribution) else None
            found = logs[nearest] if nearest is not None else np.interp(points[:, i], grid, logs)
            total += np.maximum(found, math.log(_LEAST_DENSITY))
        return total


@dataclass(frozen=True)
class _Model:
    """A fitted surrogate of normalised values."""

    regressor: Any
    mean: float
    spread: float

    def predict(self, features: Array) -> tuple[Array, Array]:
        """Returns mean and standard deviation."""
        if isinstance(self.regressor, RandomForestRegressor):
            trees = np.array([tree.predict(features) for tree in self.regressor.estimators_])
            mean, deviation = trees.mean(axis=0), trees.std(axis=0)
        else:
            mean, deviation = self.regressor.predict(features, return_std=True)
        return mean * self.spread + self.mean, np.maximum(deviation * self.spread, 1e-9)


@dataclass(frozen=True)
class _Acquisition:
    """The logarithm of the acquisition: expected improvement, feasibility and prior.

    :param model: None if no trial is feasible: then only feasibility and prior count.
    :param limits: models of the constraints, which hold at 0 or less.
    :param classifier: of failed trials; None if none has failed.
    """

    space: _Space
    model: _Model | None
    best: float
    limits: Sequence[_Model]
    classifier: Any
    strength: float

    def __call__(self, points: Array) -> Array:
        features = self.space.features(points)
        total = self.strength * self.space.log_prior(points)
        if self.model is not None:
            mean, deviation = self.model.predict(features)
            z = (self.best - mean) / deviation
            improvement = deviation * (z * norm.cdf(z) + norm.pdf(z))
            total = total + np.log(np.maximum(improvement, 1e-30))
        for limit in self.limits:
            mean, deviation = limit.predict(features)
            total = total + norm.logcdf(-mean / deviation)
        if self.classifier is not None:
            column = list(self.classifier.classes_).index(True)
            total = total + np.log(np.maximum(self.classifier.predict_proba(features)[:, column], 1e-3))
        return total


def _maximise(
    space: _Space, acquisition: _Acquisition, complete: Sequence[FrozenTrial], random: np.random.Generator
) -> Array:
    """Returns the best candidate: from the prior, at random, and near good trials; the best ones are refined."""
    third = _CANDIDATES // 3
    observed = space.points(complete)
    good = observed[np.argsort(acquisition(observed))[::-1][:_REFINED]]
    close = space.near(good, third // len(good), 0.1, random)
    candidates = np.vstack([space.from_prior(third, random), space.uniform(third, random), close])
    seen = {tuple(point) for point in observed}
    fresh = [i for i, point in enumerate(candidates) if tuple(point) not in seen]
    if fresh:  # of a small discrete space all values may have been tried
        candidates = candidates[fresh]
    scores = acquisition(candidates)
    for spread in (0.05, 0.01):
        top = candidates[np.argsort(scores)[::-1][:_REFINED]]
        refined = space.near(top, _AROUND, spread, random)
        refined = np.array([point for point in refined if tuple(point) not in seen] or top)
        candidates = np.vstack([top, refined])
        scores = acquisition(candidates)
    best: Array = candidates[int(np.argmax(scores))]
    return best


def _scalarised(
    directions: Sequence[StudyDirection], trials: Sequence[FrozenTrial], random: np.random.Generator
) -> Array:
    """Returns one value per trial, to be minimised: with several objectives, at random weights."""
    signs = np.array([-1.0 if direction is StudyDirection.MAXIMIZE else 1.0 for direction in directions])
    values = np.array([each.values for each in trials]) * signs
    if values.shape[1] == 1:
        only: Array = values[:, 0]
        return only
    low, high = values.min(axis=0), values.max(axis=0)
    normal = (values - low) / np.where(high > low, high - low, 1.0)
    weighted = normal * random.dirichlet(np.ones(values.shape[1]))
    scalarised: Array = weighted.max(axis=1) + _AUGMENTATION * weighted.sum(axis=1)
    return scalarised


def _is_nominal(distribution: BaseDistribution) -> bool:
    """Whether the values have no order."""
    return isinstance(distribution, CategoricalDistribution) and not all(
        isinstance(choice, int | float) and not isinstance(choice, bool) for choice in distribution.choices
    )


def _order(distribution: CategoricalDistribution) -> list[Any]:
    """Returns the choices; those of an ordinal variable in ascending order."""
    choices = list(distribution.choices)
    return choices if _is_nominal(distribution) else sorted(choices)


def _count(distribution: BaseDistribution) -> int:
    """Returns the number of values; 0 for infinitely many."""
    if isinstance(distribution, CategoricalDistribution):
        return len(distribution.choices)
    if isinstance(distribution, IntDistribution | FloatDistribution) and distribution.step:
        return round((distribution.high - distribution.low) / distribution.step) + 1
    return 0


def _grid(distribution: BaseDistribution) -> Array:
    """Returns points of one variable that cover its range."""
    count = _count(distribution)
    if _is_nominal(distribution):
        return np.arange(count, dtype=float)
    return np.linspace(0.0, 1.0, count if 0 < count <= 1000 else 501)


def _round_units(distribution: BaseDistribution, units: Array) -> Array:
    if _is_nominal(distribution):
        return units
    count = _count(distribution)
    if count > 1 and not getattr(distribution, "log", False):
        rounded: Array = np.round(units * (count - 1)) / (count - 1)
        return rounded
    return units


def _to_unit(distribution: BaseDistribution, value: Any) -> float:
    if isinstance(distribution, CategoricalDistribution):
        index = _order(distribution).index(value)
        return float(index) if _is_nominal(distribution) else index / max(1, len(distribution.choices) - 1)
    assert isinstance(distribution, FloatDistribution | IntDistribution)
    low, high = float(distribution.low), float(distribution.high)
    if distribution.log:
        return math.log(value / low) / math.log(high / low)
    return (float(value) - low) / (high - low)


def _from_unit(distribution: BaseDistribution, unit: float) -> Any:
    if isinstance(distribution, CategoricalDistribution):
        choices = _order(distribution)
        return choices[round(unit if _is_nominal(distribution) else unit * (len(choices) - 1))]
    assert isinstance(distribution, FloatDistribution | IntDistribution)
    low, high = float(distribution.low), float(distribution.high)
    value = low * (high / low) ** unit if distribution.log else low + unit * (high - low)
    if distribution.step:
        value = low + round((value - low) / distribution.step) * distribution.step
    value = min(max(value, low), high)
    return round(value) if isinstance(distribution, IntDistribution) else value
