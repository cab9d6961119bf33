"""A sampler for Optuna: Bayesian optimisation that is guided by priors, for one or several objectives.

It needs Optuna, NumPy and SciPy, and of this project only `search_space.py` and `surrogate.py`:

    sampler = PriorSampler({"x": Normal(0.2, 0.05), "gait": Choice({"walk": 3, "trot": 1})}, seed=1)
    study = optuna.create_study(sampler=sampler)

It combines:

- Variables may be real, integer, ordinal (categorical with numbers only) and categorical.
- The first trials cover the prior evenly, as a Latin hypercube. Then a Gaussian process is fitted to the values, which
  are warped to be closer to normal ones. It separates the function from the noise of its values: known noise follows
  from repetitions (attribute `repetitions` of a trial), the rest is estimated.
- The next trial maximises the expected improvement on the best mean of the process, multiplied by the prior to the
  power of w beta/n in the n-th trial after the first ones (Hvarfner et al., "πBO: Augmenting Acquisition Functions with
  User Beliefs for Bayesian Optimization", ICLR 2022). The weight w is the probability that values are better where the
  prior is high, by the model's evidence with and without such a trend: a good prior helps early, one that the data
  contradict loses its weight. A third of the first trials is uniform.
- Several objectives are scalarised with random weights in each trial by the augmented Chebyshev function (Knowles,
  "ParEGO", 2006; Paria et al., "A Flexible Framework for Multi-Objective Bayesian Optimization using Random
  Scalarizations", 2019).
- With constraints (`trial.set_constraint`) the acquisition is multiplied by the probability of feasibility (Gardner et
  al., "Bayesian Optimization with Inequality Constraints", 2014). Their values are compressed far from the limit
  (Eriksson and Poloczek, "Scalable Constrained Bayesian Optimization", 2021): the model is exact where it matters.
- Without priors, trials without success (attribute `success_rate` of a trial is 0) count as no better than the worst
  one with success, in each objective: a tool that touches nothing has the least force. As long as no trial has
  succeeded and an objective has one value everywhere, trials are drawn: a model of equal values would only search the
  edges of the ranges.
- Running trials count with the worst value, so that parallel trials differ.

The random numbers of a trial depend on the seed and the number of the trial: a study that is resumed continues as it
would have, if its trials end in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler
from optuna.search_space import IntersectionSearchSpace
from optuna.study import Study, StudyDirection
from optuna.trial import FrozenTrial, TrialState
from scipy.special import erfcx, expit, log_ndtr, ndtr
from threadpoolctl import threadpool_limits

from skiros2_learning.core.search_space import Array, Choice, Condition, Kernels, Normal, Prior, SearchSpace
from skiros2_learning.core.surrogate import Surrogate, fit_surrogate
from skiros2_learning.core.trial_values import is_plateau, warped_objectives

__all__ = ["Choice", "Kernels", "Normal", "Prior", "PriorSampler"]

#: Candidates of a trial, and how many of the best ones are refined.
_CANDIDATES, _REFINED, _AROUND = 1500, 5, 40
#: Deviations of the refinements, one after the other, relative to the ranges.
_SPREADS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
#: With priors, each trial of this number among the first ones is uniform.
_UNIFORM_SHARE = 3
#: Logarithm of the odds of a prior that helps, before there are values.
_TRUST = math.log(3.0)
#: Deviations of the model by which a constraint is to hold.
_MARGIN = 1.0
#: Weight of the sum in the augmented Chebyshev function.
_AUGMENTATION = 0.05

_LOG_ROOT = 0.5 * math.log(2.0 * math.pi)


class PriorSampler(BaseSampler):
    """See the module.

    :param priors: by name of the variable; others are uniform.
    :param n_startup_trials: trials that cover the prior before the first surrogate.
    :param beta: strength of the prior; a tenth of the number of trials is a good value.
    :param seed: of all random numbers; None for another one each time.
    :param space: all variables, if some exist only with values of others; None: those that all trials have.
    :param conditions: of these, those of a variable after those of the variables that it needs.
    :param allowed: whether values satisfy constraints between variables; None if there are none. The first trial, for
        which the variables are not known yet, may violate them.
    """

    def __init__(
        self,
        priors: Mapping[str, Prior] | None = None,
        *,
        n_startup_trials: int = 10,
        beta: float = 10.0,
        seed: int | None = None,
        allowed: Callable[[Mapping[str, Any]], bool] | None = None,
        space: Mapping[str, BaseDistribution] | None = None,
        conditions: Sequence[Condition] = (),
    ) -> None:
        self._priors = dict(priors or {})
        self._startup = n_startup_trials
        self._beta = beta
        self._allowed = allowed
        self._known = space
        self._conditions = conditions
        self._seed = int(np.random.default_rng(seed).integers(2**31))
        self._space = IntersectionSearchSpace(include_pruned=True)

    def reseed_rng(self) -> None:
        """Does nothing: random numbers depend on the number of the trial."""

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        found = self._space.calculate(study) if self._known is None else self._known
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
        may_miss = {each.name for each in self._conditions}
        trials = [
            each
            for each in study.get_trials(deepcopy=False)
            if each.number != trial.number and set(search_space) - may_miss <= set(each.params)
        ]
        complete = [each for each in trials if each.state is TrialState.COMPLETE]
        random = np.random.default_rng([self._seed, trial.number])
        space = SearchSpace(search_space, self._priors, self._conditions)
        if trial.number < self._startup:
            is_uniform = trial.number % _UNIFORM_SHARE == _UNIFORM_SHARE - 1
            start = SearchSpace(search_space, {}, self._conditions) if is_uniform else space
            point = start.covering(self._startup, np.random.default_rng(self._seed))[trial.number]
            return space.values(self._fitting(space, np.vstack([point, space.from_prior(_CANDIDATES, random)]))[0])
        if len(complete) < 2:
            return self.drawn(space, random)
        if not self._priors and is_plateau(complete):
            return self.drawn(space, random)
        ended = [each for each in trials if each.state.is_finished()]
        running = [each for each in trials if each.state is TrialState.RUNNING]
        known = Trials(space, study.directions, complete, ended, running, random, not self._priors)
        with threadpool_limits(1):  # the matrices are small: threads would cost more than they bring
            return self.suggested(known)

    def drawn(self, space: SearchSpace, random: np.random.Generator) -> dict[str, Any]:
        """Returns values from the prior, by name, that satisfy the constraints between variables if any do."""
        return space.values(self._fitting(space, space.from_prior(_CANDIDATES, random))[0])

    def suggested(self, trials: Trials) -> dict[str, Any]:
        """Returns the values of the next trial by name. Subclasses replace this, or only `improvement`."""
        return trials.space.values(self._maximised(trials, self._acquisition(trials)))

    def _fitting(self, space: SearchSpace, points: Array) -> Array:
        """Returns the points that are allowed; all if none is."""
        allowed = self._allowed
        if allowed is None:
            return points
        fitting = np.array([allowed(space.values(point)) for point in points], dtype=bool)
        return points[fitting] if fitting.any() else points

    def recommended(self, study: Study) -> FrozenTrial:
        """Returns the trial with the best mean of the model: of noisy values, the best one has had luck.

        :raises ValueError: the study has several objectives, or no trial is complete.
        """
        found = self.ranked(study)
        if len(study.directions) > 1 or not found:
            raise ValueError("expected one objective, and a trial that is complete")
        return found[0]

    def ranked(self, study: Study) -> list[FrozenTrial]:
        """Returns the complete trials by the model's mean of the first objective, the best one first; feasible ones
        come before others. Those that the model does not distinguish from the best one are ordered by their values.
        """
        complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        if len(complete) < 2:
            return complete
        space = SearchSpace(self.infer_relative_search_space(study, complete[0]), {}, self._conditions)
        points, random = space.points(complete), np.random.default_rng(self._seed)
        values, noise = _scalarised(study.directions[:1], complete, random, not self._priors)
        with threadpool_limits(1):
            model = fit_surrogate(points, values, random, nominal=space.nominal, noise=noise)
            means, deviations = model.predict(points)
        limit = min(mean + deviation for mean, deviation in zip(means, deviations, strict=True))
        close = means <= limit
        return [complete[i] for i in np.lexsort((np.where(close, values, means), ~close, ~_feasible(complete)))]

    def improvement(self, trials: Trials, model: Surrogate) -> Callable[[Array], Array]:
        """Returns a function that gives the logarithm of the improvement that is expected at points, shape (n,).

        :param trials: of which at least one is feasible.
        :param model: of the values, to be minimised; several objectives are scalarised.
        """
        best = float(model.predict(trials.observed[trials.feasible])[0].min())

        def log_improvement(points: Array) -> Array:
            mean, deviation = model.predict(points)
            return np.log(deviation) + _log_improvement((best - mean) / deviation)

        return log_improvement

    def _acquisition(self, trials: Trials) -> _Acquisition:
        space, complete, running, random = trials.space, trials.complete, trials.running, trials.random
        observed = trials.observed
        values, noise = _scalarised(trials.directions, complete, random, trials.success_is_rare)
        model: Surrogate | None = None
        improvement = None
        strength = 0.0
        if trials.feasible.any():
            points = np.vstack([observed, space.points(running)]) if running else observed
            pending = np.zeros(len(running))
            model = fit_surrogate(
                points,
                np.concatenate([values, pending + values.max()]),
                random,
                nominal=space.nominal,
                noise=np.concatenate([noise, pending]),
            )
            improvement = self.improvement(trials, model)
        if self._priors:
            strength = self._beta / max(1, len(complete) - self._startup + 1)
            if model is not None:
                strength *= expit(_TRUST + model.log_support(space.log_prior(model.features)))
        limits = [
            fit_surrogate(
                observed,
                _compressed(np.array([each.constraints[name] for each in complete])),
                random,
                nominal=space.nominal,
            )
            for name in sorted(set.intersection(*(set(each.constraints) for each in complete)))
        ]
        tried = [each for each in trials.ended if each.state in (TrialState.COMPLETE, TrialState.FAIL)]
        works = None
        if len(tried) > len(complete):
            ends = np.array([float(each.state is TrialState.COMPLETE) for each in tried])
            works = fit_surrogate(space.points(tried), ends, random, nominal=space.nominal)
        return _Acquisition(space, improvement, limits, works, strength)

    def _maximised(self, trials: Trials, acquisition: _Acquisition) -> Array:
        """Returns the best candidate: from the prior, at random, and near good trials; the best ones are refined."""
        space, random, observed = trials.space, trials.random, trials.observed
        third = _CANDIDATES // 3
        good = observed[np.argsort(acquisition(observed))[::-1][:_REFINED]]
        close = space.near(good, third // len(good), 0.1, random)
        candidates = np.vstack([space.from_prior(third, random), space.uniform(third, random), close])
        candidates = self._fitting(space, candidates)
        seen = {tuple(point) for point in space.points([*trials.complete, *trials.running])}
        fresh = [i for i, point in enumerate(candidates) if tuple(point) not in seen]
        if fresh:  # of a small discrete space all values may have been tried
            candidates = candidates[fresh]
        scores = acquisition(candidates)
        for spread in _SPREADS:
            order = np.argsort(scores)[::-1][:_REFINED]
            top = candidates[order]
            refined = space.near(top, _AROUND, spread, random)
            refined = np.array([point for point in refined if tuple(point) not in seen] or top)
            refined = self._fitting(space, refined)
            candidates = np.vstack([top, refined])
            scores = np.concatenate([scores[order], acquisition(refined)])
        best: Array = candidates[int(np.argmax(scores))]
        return best


@dataclass(frozen=True)
class Trials:
    """What a sampler knows before a trial.

    :param complete: at least two, with values.
    :param ended: also those that have failed or were pruned.
    :param running: in other threads or processes.
    :param random: numbers of this trial.
    :param success_is_rare: see `warped_objectives`.
    """

    space: SearchSpace
    directions: Sequence[StudyDirection]
    complete: Sequence[FrozenTrial]
    ended: Sequence[FrozenTrial]
    running: Sequence[FrozenTrial]
    random: np.random.Generator
    success_is_rare: bool

    @cached_property
    def observed(self) -> Array:
        """The points of the complete trials, shape (n, d)."""
        return self.space.points(self.complete)

    @cached_property
    def feasible(self) -> npt.NDArray[np.bool_]:
        """Whether the complete trials satisfy all constraints, shape (n,)."""
        return _feasible(self.complete)


@dataclass(frozen=True)
class _Acquisition:
    """The logarithm of the acquisition: expected improvement, feasibility and prior.

    :param improvement: None if no trial is feasible: then only feasibility and prior count.
    :param limits: models of the constraints, which hold at 0 or less: to be kept with a margin, since the
        optimum is often at a limit.
    :param works: model of whether a trial has a result, 1 or 0; None if none has failed.
    """

    space: SearchSpace
    improvement: Callable[[Array], Array] | None
    limits: Sequence[Surrogate]
    works: Surrogate | None
    strength: float

    def __call__(self, points: Array) -> Array:
        total = np.zeros(len(points))
        if self.strength:
            total += self.strength * self.space.log_prior(points)
        if self.improvement is not None:
            total += self.improvement(points)
        for limit in self.limits:
            mean, deviation = limit.predict(points)
            total += log_ndtr(-mean / deviation - _MARGIN)
        if self.works is not None:
            total += np.log(np.clip(self.works.predict(points)[0], 1e-3, 1.0))
        return total


def _log_improvement(z: Array) -> Array:
    """Returns the logarithm of the expected improvement, relative to the deviation, also where it is tiny (Ament et
    al., "Unexpected Improvements to Expected Improvement for Bayesian Optimization", 2023)."""
    low = np.minimum(z, -1.0)
    ratio = 1.0 + low * math.sqrt(math.pi / 2.0) * erfcx(-low / math.sqrt(2.0))
    small = -0.5 * low**2 - _LOG_ROOT + np.where(low < -1e3, -2.0 * np.log(-low), np.log(np.maximum(ratio, 1e-12)))
    high = np.maximum(z, -1.0)
    found: Array = np.where(z < -1.0, small, np.log(high * ndtr(high) + np.exp(-0.5 * high**2 - _LOG_ROOT)))
    return found


def _compressed(values: Array) -> Array:
    """Returns the values of a constraint with their signs, those far from 0 closer to it."""
    scale = float(np.median(np.abs(values))) or 1.0
    compressed: Array = np.sign(values) * np.log1p(np.abs(values) / scale)
    return compressed


def _feasible(trials: Sequence[FrozenTrial]) -> npt.NDArray[np.bool_]:
    return np.array([all(value <= 0.0 for value in each.constraints.values()) for each in trials])


def _scalarised(
    directions: Sequence[StudyDirection],
    trials: Sequence[FrozenTrial],
    random: np.random.Generator,
    success_is_rare: bool,
) -> tuple[Array, Array]:
    """Returns one value per trial, to be minimised, and the variance of its noise as far as it is known. Several
    objectives have random weights.

    :param directions: of the first objectives, which count.
    :param success_is_rare: see `warped_objectives`.
    """
    warped, errors = warped_objectives(directions, trials, success_is_rare)
    if warped.shape[1] == 1:
        return warped[:, 0], errors[:, 0] ** 2
    low, high = warped.min(axis=0), warped.max(axis=0)
    spread = np.where(high > low, high - low, 1.0)
    weights = random.dirichlet(np.ones(warped.shape[1]))
    weighted = (warped - low) / spread * weights
    scalarised: Array = weighted.max(axis=1) + _AUGMENTATION * weighted.sum(axis=1)
    noise: Array = ((errors / spread * weights) ** 2).max(axis=1)
    return scalarised, noise
