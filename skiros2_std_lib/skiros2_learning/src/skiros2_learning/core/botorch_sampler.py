"""A sampler with the models and acquisitions of BoTorch, and the priors, constraints and search of `PriorSampler`.

One objective: noisy expected improvement (qLogNEI). Several: noisy expected improvement of the hypervolume (qLogNEHVI;
both: Ament et al., "Unexpected Improvements to Expected Improvement for Bayesian Optimization", 2023). The import takes
seconds, for torch.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import torch
from botorch.acquisition import AcquisitionFunction
from botorch.acquisition.logei import qLogNoisyExpectedImprovement
from botorch.acquisition.multi_objective.logei import qLogNoisyExpectedHypervolumeImprovement
from botorch.exceptions import InputDataWarning
from botorch.fit import fit_gpytorch_mll
from botorch.models import MixedSingleTaskGP, ModelListGP, SingleTaskGP
from botorch.sampling import SobolQMCNormalSampler
from botorch.utils.multi_objective.hypervolume import infer_reference_point
from botorch.utils.multi_objective.pareto import is_non_dominated
from gpytorch.mlls import ExactMarginalLogLikelihood
from linear_operator.utils.warnings import NumericalWarning

from skiros2_learning.core.prior_sampler import PriorSampler, Trials
from skiros2_learning.core.search_space import Array
from skiros2_learning.core.surrogate import Surrogate
from skiros2_learning.core.trial_values import warped_objectives

#: Samples of the values of one objective, and of several; points of one call. They limit time and memory.
_SAMPLES, _SAMPLES_OF_SEVERAL, _AT_ONCE = 128, 64, 250
#: Smallest variance of a value, of values with a variance near 1.
_LEAST_VARIANCE = 1e-6


class BoTorchSampler(PriorSampler):
    """See the module and `PriorSampler`, which also has the parameters."""

    def improvement(self, trials: Trials, model: Surrogate) -> Callable[[Array], Array]:
        seed = int(trials.random.integers(2**31))
        with torch.random.fork_rng(devices=[]), _without_warnings():
            torch.manual_seed(seed)
            acquisition = _acquisition(trials, seed)

        def log_improvement(points: Array) -> Array:
            parts = torch.from_numpy(points).unsqueeze(1).split(_AT_ONCE)
            with torch.no_grad(), _without_warnings():
                return np.concatenate([acquisition(part).numpy() for part in parts])

        return log_improvement


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Hides what BoTorch warns of and handles: values that are not standardised, matrices that are almost singular."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputDataWarning)
        warnings.simplefilter("ignore", NumericalWarning)
        yield


def _acquisition(trials: Trials, seed: int) -> AcquisitionFunction:
    costs, errors = warped_objectives(trials.directions, trials.complete, trials.success_is_rare)
    points, gains = torch.from_numpy(trials.observed), torch.from_numpy(-costs)
    models = [
        _fitted(points, gains[:, i, None], torch.from_numpy(errors[:, i, None] ** 2), trials.space.nominal)
        for i in range(gains.shape[1])
    ]
    feasible = torch.from_numpy(trials.feasible)
    pending = torch.from_numpy(trials.space.points(trials.running)) if trials.running else None
    if len(models) == 1:
        sampler = SobolQMCNormalSampler(torch.Size([_SAMPLES]), seed=seed)
        return qLogNoisyExpectedImprovement(models[0], points[feasible], sampler, X_pending=pending)
    best = gains[feasible]
    return qLogNoisyExpectedHypervolumeImprovement(
        ModelListGP(*models),
        infer_reference_point(best[is_non_dominated(best)]),
        points[feasible],
        SobolQMCNormalSampler(torch.Size([_SAMPLES_OF_SEVERAL]), seed=seed),
        X_pending=pending,
        prune_baseline=True,
    )


def _fitted(points: torch.Tensor, gains: torch.Tensor, noise: torch.Tensor, nominal: Sequence[bool]) -> SingleTaskGP:
    """Returns a Gaussian process of one objective.

    :param points, gains, noise: inputs, shape (n, d), values, which are to be maximised, and their variances, of shape
        (n, 1). Variances of 0 are not known, and estimated.
    """
    known = noise.clamp_min(_LEAST_VARIANCE) if bool((noise > 0.0).any()) else None
    unordered = [i for i, each in enumerate(nominal) if each]
    made = MixedSingleTaskGP(points, gains, unordered, known) if unordered else SingleTaskGP(points, gains, known)
    fit_gpytorch_mll(ExactMarginalLogLikelihood(made.likelihood, made))
    return made
