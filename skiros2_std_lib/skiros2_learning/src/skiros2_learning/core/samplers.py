"""The samplers that a scenario may name: that of this package, and those of Optuna, BoTorch and SMAC3."""

from __future__ import annotations

import importlib.util
import warnings

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.samplers import BaseSampler

from skiros2_common.core.errors import ConfigurationError, MissingPackage
from skiros2_learning.core.prior_sampler import Choice, Kernels, Normal, Prior, PriorSampler
from skiros2_learning.core.scenario import Optimiser, Scenario
from skiros2_learning.core.search_space import Condition
from skiros2_learning.core.variables import Gaussian, Samples, Variable, Weights

#: Modules that samplers need besides the packages for learning: of requirements/optimisers.txt.
_MODULES: dict[Optimiser, str] = {
    "cmaes": "cmaes", "gp": "torch", "optuna-gp": "torch", "botorch": "botorch", "smac": "smac"
}  # fmt: skip


def distribution_of(variable: Variable) -> BaseDistribution:
    """Returns Optuna's distribution of a variable."""
    if variable.kind == "real":
        return FloatDistribution(variable.low, variable.high, log=variable.scale == "log")
    if variable.kind == "integer":
        return IntDistribution(round(variable.low), round(variable.high), log=variable.scale == "log")
    return CategoricalDistribution(variable.values)


def conditions_of(scenario: Scenario) -> list[Condition]:
    """Returns the conditions under which variables exist."""
    return [Condition(v.name, name, values) for v in scenario.variables for name, values in v.only_if.items()]


def prior_of(variable: Variable) -> Prior | None:
    """Returns the prior of a variable for the sampler."""
    if isinstance(variable.prior, Gaussian):
        return Normal(variable.prior.mean, variable.prior.std)
    if isinstance(variable.prior, Samples):
        return Kernels(variable.prior.values, variable.prior.std)
    if isinstance(variable.prior, Weights):
        return Choice(dict(zip(variable.values, variable.prior.values, strict=True)))
    return None


def make_sampler(scenario: Scenario) -> BaseSampler:
    """Returns the sampler that a scenario names. Priors count in `prior`, `botorch` and `smac`.

    :raises MissingPackage: it needs a package that is not installed; the text has the command that installs it.
    :raises ConfigurationError: it does not search for several objectives.
    """
    seed, initial, chosen = scenario.seed, scenario.budget.initial, scenario.optimiser
    if chosen == "cmaes" and len(scenario.objectives) > 1:
        raise ConfigurationError("optimiser cmaes: expected one objective; take prior, tpe or nsga2 for several")
    if missing := _missing_package(chosen):
        raise MissingPackage(f"optimiser {chosen} {missing}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        match chosen:
            case "prior" | "botorch" | "smac":
                return _prior_sampler(scenario)
            case "tpe":
                group = bool(conditions_of(scenario))
                return optuna.samplers.TPESampler(n_startup_trials=initial, multivariate=True, group=group, seed=seed)
            case "nsga2":
                return optuna.samplers.NSGAIISampler(population_size=max(2, initial), seed=seed)
            case "qmc":
                return optuna.samplers.QMCSampler(seed=seed)
            case "cmaes":
                return optuna.samplers.CmaEsSampler(n_startup_trials=initial, seed=seed)
            case "gp" | "optuna-gp":
                return optuna.samplers.GPSampler(n_startup_trials=initial, seed=seed)
            case "random":
                return optuna.samplers.RandomSampler(seed=seed)


def better_sampler(scenario: Scenario) -> str:
    """Describes a sampler that was better than the scenario's in the measurements of docs/learning.md; "" if none was:
    that with constraints and one objective. It has no priors, conditional variables or limits between variables."""
    has_more = bool(scenario.restrictions) or any(each.prior or each.only_if for each in scenario.variables)
    if scenario.optimiser != "prior" or not scenario.constraints or len(scenario.objectives) > 1 or has_more:
        return ""
    missing = _missing_package("optuna-gp")
    text = "optimiser optuna-gp found better values with constraints, in one measured function (docs/learning.md)"
    return f"{text}; it {missing or 'is installed'}"


def _missing_package(optimiser: Optimiser) -> str:
    """Describes what a sampler needs that is not installed; "" if nothing."""
    module = _MODULES.get(optimiser)
    if module is None or importlib.util.find_spec(module) is not None:
        return ""
    return f'needs {module}; in the folder of SkiROS2: make setup FOR="learning optimisers"'


def _prior_sampler(scenario: Scenario) -> BaseSampler:
    """Returns the sampler with priors that a scenario names. Two of them import libraries that take seconds."""
    made = PriorSampler
    if scenario.optimiser == "botorch":
        from skiros2_learning.core.botorch_sampler import BoTorchSampler as made
    elif scenario.optimiser == "smac":
        from skiros2_learning.core.smac_sampler import SmacSampler as made
    conditions = conditions_of(scenario)
    return made(
        {v.name: prior for v in scenario.variables if (prior := prior_of(v)) is not None},
        n_startup_trials=scenario.budget.initial,
        beta=max(1.0, scenario.budget.evaluations / 10),
        seed=scenario.seed,
        allowed=scenario.allows if scenario.restrictions else None,
        space={v.name: distribution_of(v) for v in scenario.variables} if conditions else None,
        conditions=conditions,
    )
