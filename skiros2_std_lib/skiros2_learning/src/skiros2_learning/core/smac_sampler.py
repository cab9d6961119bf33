"""A sampler that asks SMAC3 (Lindauer et al., "SMAC3: A Versatile Bayesian Optimization Package for Hyperparameter
Optimization", 2022): its Gaussian process with expected improvement, its πBO, and its ParEGO for several objectives.

The first trials are those of `PriorSampler`. SMAC is created for each trial, from all that are complete: it has no
state, and a study that is resumed continues as it would have. It does not know constraints: a trial that violates one
counts as worse than all others, by its violation.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from ConfigSpace import CategoricalHyperparameter, Configuration, ConfigurationSpace, UniformFloatHyperparameter
from smac import BlackBoxFacade, Scenario
from smac.acquisition.function import EI, PriorAcquisitionFunction
from smac.main.exceptions import ConfigurationSpaceExhaustedException
from smac.multi_objective import ParEGO
from smac.runhistory.dataclasses import TrialInfo, TrialValue

from skiros2_learning.core.prior_sampler import PriorSampler, Trials
from skiros2_learning.core.search_space import Array, SearchSpace
from skiros2_learning.core.trial_values import warped_objectives

logging.getLogger("smac").setLevel(logging.ERROR)  # it warns that it has no initial design of its own

#: Suggestions of which the first one that satisfies the constraints between variables is taken.
_SUGGESTIONS = 50


class SmacSampler(PriorSampler):
    """See the module and `PriorSampler`, which also has the parameters."""

    def suggested(self, trials: Trials) -> dict[str, Any]:
        space, seed = trials.space, int(trials.random.integers(2**31))
        units = _unit_space(space, seed)
        with TemporaryDirectory() as folder:
            scenario = Scenario(
                units,
                objectives=[str(i) for i in range(len(trials.directions))],
                deterministic=True,
                n_trials=len(trials.complete) + _SUGGESTIONS,
                output_directory=Path(folder),
                seed=seed,
            )
            strength = self._beta / max(1, len(trials.complete) - self._startup + 1)
            smac = BlackBoxFacade(
                scenario,
                _values,
                acquisition_function=_Weighted(EI(), space, strength) if self._priors else EI(),
                initial_design=BlackBoxFacade.get_initial_design(scenario, n_configs=0),
                multi_objective_algorithm=ParEGO(scenario) if len(trials.directions) > 1 else None,
                logging_level=False,
            )
            for point, costs in zip(trials.observed, _costs(trials), strict=True):
                info = TrialInfo(Configuration(units, vector=point), seed=0)
                smac.tell(info, TrialValue(costs.tolist() if len(costs) > 1 else float(costs[0])), save=False)
            with suppress(ConfigurationSpaceExhaustedException):
                for _ in range(_SUGGESTIONS):
                    values = space.values(space.rounded(smac.ask().config.get_array()[None, :])[0])
                    if self._allowed is None or self._allowed(values):
                        return values
        return self.drawn(space, trials.random)


class _Weighted(PriorAcquisitionFunction):  # type: ignore[misc]  # optional: its type is not known
    """πBO with the prior of a search space, at SMAC's vectors, which are its points.

    :param strength: power of the prior in this trial.
    """

    def __init__(self, acquisition: EI, space: SearchSpace, strength: float) -> None:
        super().__init__(acquisition, decay_beta=strength)
        self._space = space

    def _compute_prior(self, points: Array) -> Array:
        density: Array = np.exp(self._space.log_prior(points))[:, None]
        return density


def _unit_space(space: SearchSpace, seed: int) -> ConfigurationSpace:
    """Returns a space with a variable for each number of a point. Their names keep the order."""
    units = ConfigurationSpace(seed=seed)
    for i, choices in enumerate(space.choices):
        name = f"{i:04d}"
        units.add(
            CategoricalHyperparameter(name, range(choices)) if choices else UniformFloatHyperparameter(name, 0.0, 1.0)
        )
    return units


def _costs(trials: Trials) -> Array:
    """Returns the values of trials for SMAC, to be minimised, shape (n, m)."""
    costs, _ = warped_objectives(trials.directions, trials.complete, trials.success_is_rare)
    excess = np.array([max([0.0, *each.constraints.values()]) for each in trials.complete])
    worst = costs.max(axis=0) + np.ptp(costs, axis=0) * (excess / (excess.max() or 1.0))[:, None]
    found: Array = np.where(trials.feasible[:, None], costs, worst)
    return found


def _values(config: Configuration, seed: int) -> list[float]:
    """The function that SMAC would call if it ran the trials: it is asked only."""
    raise NotImplementedError
