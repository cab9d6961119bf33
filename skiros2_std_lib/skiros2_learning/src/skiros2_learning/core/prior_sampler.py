"""A sampler for Optuna: Bayesian optimisation that is guided by priors, for one or several objectives.

It needs Optuna, NumPy, SciPy and scikit-learn, and of this project only `search_space.py` and `surrogate.py`:

    sampler = PriorSampler({"x": Normal(0.2, 0.05), "gait": Choice({"walk": 3, "trot": 1})}, seed=1)
    study = optuna.create_study(sampler=sampler)

It combines:

- Variables may be real, integer, ordinal (categorical with numbers only) and categorical.
- The first trials cover the prior evenly, as a Latin hypercube. Then a surrogate is fitted: a Gaussian process (Matérn
  5/2, one length scale for each variable), or a random forest with many observations or with categorical variables.
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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler
from optuna.search_space import IntersectionSearchSpace
from optuna.study import Study, StudyDirection
from optuna.trial import FrozenTrial, TrialState
from scipy.stats import norm
from sklearn.ensemble import RandomForestClassifier
from threadpoolctl import threadpool_limits

from skiros2_learning.core.search_space import Array, Choice, Kernels, Normal, Prior, SearchSpace
from skiros2_learning.core.surrogate import TREES, Surrogate, SurrogateKind, fit_surrogate

__all__ = ["Choice", "Kernels", "Normal", "Prior", "PriorSampler"]

#: Observations up to which a Gaussian process is fitted: its time grows with their third power.
MAX_GAUSSIAN_PROCESS = 120
#: Candidates of a trial, and how many of the best ones are refined.
_CANDIDATES, _REFINED, _AROUND = 1500, 5, 60
#: Weight of the sum in the augmented Chebyshev function.
_AUGMENTATION = 0.05


class PriorSampler(BaseSampler):
    """See the module.

    :param priors: by name of the variable; others are uniform.
    :param n_startup_trials: trials that cover the prior before the first surrogate.
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
        space = SearchSpace({param_name: param_distribution}, self._priors)
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
        space = SearchSpace(search_space, self._priors)
        if trial.number < self._startup:
            start = np.random.default_rng(self._seed)
            return space.values(space.covering(self._startup, start)[trial.number])
        if len(complete) < 2:
            return space.values(space.from_prior(1, random)[0])
        ended = [each for each in trials if each.state.is_finished()]
        running = [each for each in trials if each.state is TrialState.RUNNING]
        with threadpool_limits(1):  # the matrices are small: threads would cost more than they bring
            acquisition = self._acquisition(space, study, complete, ended, running, random)
            return space.values(_maximise(space, acquisition, complete, random))

    def _acquisition(
        self,
        space: SearchSpace,
        study: Study,
        complete: Sequence[FrozenTrial],
        ended: Sequence[FrozenTrial],
        running: Sequence[FrozenTrial],
        random: np.random.Generator,
    ) -> _Acquisition:
        observed = space.points(complete)
        values = _scalarised(study.directions, complete, random)
        feasible = np.array([all(value <= 0.0 for value in each.constraints.values()) for each in complete])
        model: Surrogate | None = None
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
            classifier = RandomForestClassifier(TREES, min_samples_leaf=2, random_state=int(random.integers(2**31)))
            works = [each.state is TrialState.COMPLETE for each in tried]
            classifier.fit(space.features(space.points(tried)), works)
        return _Acquisition(space, model, best, limits, classifier, self._beta / len(complete))

    def _fit(self, space: SearchSpace, points: Array, values: Array, random: np.random.Generator) -> Surrogate:
        kind: SurrogateKind
        if self._surrogate != "auto":
            kind = self._surrogate
        else:
            kind = "gp" if len(points) <= MAX_GAUSSIAN_PROCESS and not space.has_nominal else "forest"
        return fit_surrogate(kind, space.features(points), values, random)


@dataclass(frozen=True)
class _Acquisition:
    """The logarithm of the acquisition: expected improvement, feasibility and prior.

    :param model: None if no trial is feasible: then only feasibility and prior count.
    :param limits: models of the constraints, which hold at 0 or less.
    :param classifier: of failed trials; None if none has failed.
    """

    space: SearchSpace
    model: Surrogate | None
    best: float
    limits: Sequence[Surrogate]
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
    space: SearchSpace, acquisition: _Acquisition, complete: Sequence[FrozenTrial], random: np.random.Generator
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
