"""A study: the evaluations of a scenario, kept in Optuna's storage, which survives kills.

A study has a folder with the scenario, the journal of all evaluations, and reports. With a database URL, the
evaluations are in the database instead, and several machines may run the same study.
"""

from __future__ import annotations

import fcntl
import importlib.util
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.samplers import BaseSampler
from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, Trial, TrialState

from skiros2_common.core.errors import ConfigurationError, MissingPackage, Refused, UnknownName
from skiros2_learning.core.evaluation import Evaluation, seed_of
from skiros2_learning.core.prior_sampler import Choice, Kernels, Normal, PriorSampler
from skiros2_learning.core.prior_sampler import Prior as SamplerPrior
from skiros2_learning.core.scenario import Scenario, load_scenario
from skiros2_learning.core.variables import Gaussian, Samples, Value, Variable, Weights

SCENARIO_FILE, JOURNAL_FILE, LOCK_FILE = "scenario.yaml", "journal.log", "lock"
#: Attributes of Optuna's trials. One that has failed without a result was interrupted.
_RESULT, _SEED, _ERROR = "result", "seed", "error"

optuna.logging.set_verbosity(optuna.logging.WARNING)


class LearningStudy:
    """The study of a scenario. Not thread-safe.

    :param storage: a database URL, such as `postgresql://user@host/name`; "" for the journal in the folder.
    """

    def __init__(self, scenario: Scenario, folder: Path, storage: str = "") -> None:
        self.scenario = scenario
        self.folder = folder
        self._asked: dict[int, Trial] = {}
        self._distributions = {variable.name: distribution_of(variable) for variable in scenario.variables}
        directions = [
            StudyDirection.MAXIMIZE if each.sense == "maximise" else StudyDirection.MINIMIZE
            for each in scenario.objectives
        ]
        self.optuna = optuna.create_study(
            storage=_storage(folder, storage),
            study_name=scenario.name,
            directions=directions,
            sampler=make_sampler(scenario),
            load_if_exists=True,
        )
        if self.optuna.directions != directions:
            raise ConfigurationError(f"study {scenario.name!r}: the stored one has other objectives")

    @classmethod
    def create(cls, scenario: Scenario, folder: Path, storage: str = "") -> LearningStudy:
        """Creates a study.

        :raises Refused: the folder has one already.
        """
        if (folder / SCENARIO_FILE).exists():
            raise Refused(f"{folder} has a study already; resume it, or name another folder")
        folder.mkdir(parents=True, exist_ok=True)
        stored = scenario.derived()
        (folder / SCENARIO_FILE).write_text(stored.source, encoding="utf-8")
        return cls(stored, folder, storage)

    @classmethod
    def open(cls, folder: Path, storage: str = "") -> LearningStudy:
        """Opens the study in a folder.

        :raises UnknownName: there is none.
        :raises ConfigurationError: its scenario cannot be read.
        """
        if not (folder / SCENARIO_FILE).is_file():
            raise UnknownName(f"{folder} has no study: there is no {SCENARIO_FILE} in it")
        return cls(load_scenario(folder / SCENARIO_FILE), folder, storage)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Inside the `with` block, no other process may run this study from its folder.

        :raises Refused: another process runs it.
        """
        with open(self.folder / LOCK_FILE, "a", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise Refused(f"another process is running the study in {self.folder}") from None
            yield

    # -- evaluations -------------------------------------------------------------------------------------------------

    def requeue_interrupted(self) -> int:
        """Repeats the evaluations that were running when an earlier run ended. Returns their number.

        Only for a study in its folder: the trials of a database may be running on other machines.
        """
        lost = self._trials(TrialState.RUNNING)
        for trial in lost:
            attributes = {_SEED: trial.user_attrs.get(_SEED, seed_of(self.scenario, trial.number))}
            self.optuna.enqueue_trial(trial.params, user_attrs=attributes)
            self.optuna.tell(trial.number, state=TrialState.FAIL)
        return len(lost)

    def enqueue(self, configuration: dict[str, Value], seed: int | None = None) -> None:
        """Evaluates a configuration next.

        :param seed: of its draws; None for those of its number.
        """
        attributes = {} if seed is None else {_SEED: seed}
        self.optuna.enqueue_trial(dict(configuration), user_attrs=attributes, skip_if_exists=True)

    def ask(self) -> tuple[int, dict[str, Value], int]:
        """Returns number, configuration and seed of the next evaluation."""
        trial = self.optuna.ask(self._distributions)
        self._asked[trial.number] = trial
        seed = trial.user_attrs.get(_SEED)
        if seed is None:
            seed = seed_of(self.scenario, trial.number)
            trial.set_user_attr(_SEED, seed)
        return trial.number, dict(trial.params), int(seed)

    def tell(self, number: int, result: Evaluation) -> None:
        """Stores the result of an evaluation that `ask` has returned."""
        trial = self._asked.pop(number)
        trial.set_user_attr(_RESULT, json.dumps(result.to_json()))
        if result.error:
            trial.set_user_attr(_ERROR, result.error)
            self.optuna.tell(trial, state=TrialState.FAIL)
            return
        for name, violation in result.violations.items():
            trial.set_constraint(name, violation)
        values = [result.objectives[objective.name] for objective in self.scenario.objectives]
        self.optuna.tell(trial, values)

    @property
    def counted(self) -> int:
        """Number of evaluations that use up the budget: ended ones, broken ones included."""
        return sum(_RESULT in trial.user_attrs for trial in self._trials(TrialState.COMPLETE, TrialState.FAIL))

    @property
    def running_count(self) -> int:
        """Number of evaluations that are running, on all machines."""
        return len(self._trials(TrialState.RUNNING))

    def results(self) -> dict[int, Evaluation]:
        """Returns the results by number, broken ones included."""
        ended = self._trials(TrialState.COMPLETE, TrialState.FAIL)
        return {t.number: _result_of(t) for t in ended if _RESULT in t.user_attrs}

    def result(self, number: int) -> Evaluation:
        """Returns one result.

        :raises UnknownName: there is none.
        """
        found = self.results()
        if number not in found:
            raise UnknownName(f"study {self.scenario.name!r} has no result {number}; it has {_ranges(sorted(found))}")
        return found[number]

    def best(self) -> list[int]:
        """Returns the numbers of the Pareto-optimal evaluations, those with the best success rate first."""
        return self._ranked([trial.number for trial in self.optuna.best_trials] if self.counted else [])

    def ranked(self) -> list[int]:
        """Returns the numbers of all evaluations with a result: by success rate, then by the objectives in their
        order; the best one first."""
        return self._ranked([number for number, result in self.results().items() if not result.error])

    # -- internal ----------------------------------------------------------------------------------------------------

    def _ranked(self, numbers: list[int]) -> list[int]:
        results = self.results()
        sense = [1.0 if objective.sense == "minimise" else -1.0 for objective in self.scenario.objectives]

        def order(number: int) -> tuple[float, ...]:
            result = results[number]
            costs = (s * v for s, v in zip(sense, result.objectives.values(), strict=True))
            return (-result.success_rate, *costs)

        return sorted(numbers, key=order)

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return self.optuna.get_trials(deepcopy=False, states=states)


def distribution_of(variable: Variable) -> BaseDistribution:
    """Returns Optuna's distribution of a variable."""
    if variable.kind == "real":
        return FloatDistribution(variable.low, variable.high)
    if variable.kind == "integer":
        return IntDistribution(round(variable.low), round(variable.high))
    return CategoricalDistribution(variable.values)


def prior_of(variable: Variable) -> SamplerPrior | None:
    """Returns the prior of a variable for the sampler."""
    if isinstance(variable.prior, Gaussian):
        return Normal(variable.prior.mean, variable.prior.std)
    if isinstance(variable.prior, Samples):
        return Kernels(variable.prior.values, variable.prior.std)
    if isinstance(variable.prior, Weights):
        return Choice(dict(zip(variable.values, variable.prior.values, strict=True)))
    return None


def make_sampler(scenario: Scenario) -> BaseSampler:
    """Returns the sampler that a scenario names.

    :raises MissingPackage: it needs a package that is not installed.
    """
    seed, initial = scenario.seed, scenario.initial
    several = len(scenario.objectives) > 1
    if scenario.optimiser == "prior":
        priors = {v.name: prior for v in scenario.variables if (prior := prior_of(v)) is not None}
        return PriorSampler(priors, n_startup_trials=initial, beta=max(1.0, scenario.evaluations / 10), seed=seed)
    if scenario.optimiser == "tpe":
        return optuna.samplers.TPESampler(n_startup_trials=initial, multivariate=True, seed=seed)
    if scenario.optimiser == "nsga2":
        return optuna.samplers.NSGAIISampler(population_size=max(2, initial), seed=seed)
    if scenario.optimiser == "qmc":
        return optuna.samplers.QMCSampler(seed=seed)
    if scenario.optimiser == "cmaes":
        if several:
            raise ConfigurationError("optimiser cmaes: expected one objective; take prior, tpe or nsga2 for several")
        _need("cmaes", "cmaes")
        return optuna.samplers.CmaEsSampler(n_startup_trials=initial, seed=seed)
    if scenario.optimiser == "gp":
        _need("gp", "torch")
        return optuna.samplers.GPSampler(n_startup_trials=initial, seed=seed)
    return optuna.samplers.RandomSampler(seed=seed)


def _need(optimiser: str, package: str) -> None:
    if importlib.util.find_spec(package) is None:
        raise MissingPackage(f"optimiser {optimiser} needs the package {package}: pip install {package}")


def _storage(folder: Path, url: str) -> BaseStorage | str:
    if url:
        return url
    return JournalStorage(JournalFileBackend(str(folder / JOURNAL_FILE)))


def _result_of(trial: FrozenTrial) -> Evaluation:
    return Evaluation.from_json(json.loads(trial.user_attrs[_RESULT]))


def _ranges(numbers: list[int]) -> str:
    return f"{len(numbers)} results from {numbers[0]} to {numbers[-1]}" if numbers else "none"
