"""The samplers that a scenario may name: that of this package, and those of Optuna and BoTorch."""

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

#: What samplers need besides the packages for learning: modules, and what `pip install` takes.
_PACKAGES: dict[Optimiser, tuple[tuple[str, ...], str]] = {
    "cmaes": (("cmaes",), "cmaes"),
    "gp": (("torch",), "torch"),
    "optuna-gp": (("torch",), "torch"),
    "botorch": (("optuna_integration", "botorch"), "optuna-integration botorch"),
}


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
    """Returns the sampler that a scenario names. Priors count in `prior` only.

    :raises MissingPackage: it needs a package that is not installed; the text has the command that installs it.
    :raises ConfigurationError: it does not search for several objectives.
    """
    seed, initial, chosen = scenario.seed, scenario.budget.initial, scenario.optimiser
    modules, packages = _PACKAGES.get(chosen, ((), ""))
    if chosen == "cmaes" and len(scenario.objectives) > 1:
        raise ConfigurationError("optimiser cmaes: expected one objective; take prior, tpe or nsga2 for several")
    if missing := [module for module in modules if importlib.util.find_spec(module) is None]:
        raise MissingPackage(
            f"optimiser {chosen} needs {', '.join(missing)}, see docs/learning.md: pip install {packages}"
        )
    conditions = conditions_of(scenario)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        match chosen:
            case "prior":
                priors = {v.name: prior for v in scenario.variables if (prior := prior_of(v)) is not None}
                allowed = scenario.allows if scenario.restrictions else None
                beta = max(1.0, scenario.budget.evaluations / 10)
                space = {v.name: distribution_of(v) for v in scenario.variables} if conditions else None
                return PriorSampler(
                    priors, n_startup_trials=initial, beta=beta, seed=seed, allowed=allowed, space=space,
                    conditions=conditions,
                )  # fmt: skip
            case "tpe":
                group = bool(conditions)
                return optuna.samplers.TPESampler(n_startup_trials=initial, multivariate=True, group=group, seed=seed)
            case "nsga2":
                return optuna.samplers.NSGAIISampler(population_size=max(2, initial), seed=seed)
            case "qmc":
                return optuna.samplers.QMCSampler(seed=seed)
            case "cmaes":
                return optuna.samplers.CmaEsSampler(n_startup_trials=initial, seed=seed)
            case "gp" | "optuna-gp":
                return optuna.samplers.GPSampler(n_startup_trials=initial, seed=seed)
            case "botorch":
                from optuna_integration import BoTorchSampler  # imports torch, which takes seconds

                made: BaseSampler = BoTorchSampler(n_startup_trials=initial, consider_running_trials=True, seed=seed)
                return made
            case "random":
                return optuna.samplers.RandomSampler(seed=seed)
