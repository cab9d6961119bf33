"""A study: the evaluations of a scenario, kept in Optuna's storage, which survives kills.

A study has a folder with the scenario, the journal of all evaluations, and reports. With a database URL, the
evaluations are in the database instead, and several processes and machines may run the same study.
"""

from __future__ import annotations

import fcntl
import json
import logging
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from statistics import variance
from typing import TypeVar

import optuna
from optuna.distributions import BaseDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.storages import RDBStorage
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, Trial, TrialState

from skiros2_common.core.errors import ConfigurationError, Refused, UnknownName
from skiros2_common.core.yaml_text import read_yaml
from skiros2_learning.core.evaluation import Evaluation, seed_of
from skiros2_learning.core.ranking import pareto_optimal, ranked
from skiros2_learning.core.samplers import distribution_of, make_sampler
from skiros2_learning.core.scenario import Scenario, load_scenario
from skiros2_learning.core.storage import HEARTBEAT, StorageFailed, open_storage, public_name, repeat_stale, storing
from skiros2_learning.core.trial_values import REPETITIONS, SUCCESS_RATE
from skiros2_learning.core.variables import Value, Variable, configuration_problems

log = logging.getLogger(__name__)

T = TypeVar("T")

SCENARIO_FILE, LOCK_FILE = "scenario.yaml", "lock"
#: Results that could not be stored, one JSON object in each line; a file for each process.
UNSAVED_FILES = "unsaved-*.jsonl"
#: Optimisers whose random numbers depend on earlier ones: a resumed study must not draw the same ones again.
_SAMPLERS_WITH_STATE = ("tpe", "nsga2", "random", "cmaes", "gp", "optuna-gp")
#: How long a database that does not answer is tried again (s), and how often.
RECONNECT_TIMEOUT, _RECONNECT_PERIOD = 30.0, 1.0
#: Parts of a scenario that may differ between the processes that run one study in a database.
_LOCAL_KEYS = ("scene", "budget", "optimiser", "timeout", "prior_from")
#: Configurations that a sampler may propose until one satisfies the restrictions of the scenario.
_DRAWS = 200
#: Attributes of Optuna's trials. One that has failed without a result was interrupted.
_RESULT, _SEED, _ERROR = "result", "seed", "error"
#: Attribute of the study in a database: its scenario without the local keys.
_SCENARIO = "scenario"

optuna.logging.set_verbosity(optuna.logging.WARNING)


class LearningStudy:
    """The study of a scenario. Not thread-safe.

    A database that does not answer is tried again for `RECONNECT_TIMEOUT`; then, or if the journal cannot be written,
    methods raise `StorageFailed`.

    :param storage: a database URL, such as `postgresql://user@host/name`; "" for the journal in the folder.
    :raises ConfigurationError: the stored study is of another scenario.
    :raises StorageFailed: the storage cannot be opened.
    """

    def __init__(self, scenario: Scenario, folder: Path, storage: str = "") -> None:
        self.scenario = scenario
        self.folder = folder
        self._url = storage
        self._beaten = -float("inf")
        self._asked: dict[int, Trial] = {}
        self._interrupted: list[int] = []
        self._distributions = {variable.name: distribution_of(variable) for variable in scenario.variables}
        directions = [
            StudyDirection.MAXIMIZE if each.sense == "maximise" else StudyDirection.MINIMIZE
            for each in scenario.objectives
        ]
        sampler = make_sampler(scenario)
        with storing(folder, storage):
            self._storage = open_storage(folder, storage, lambda study, trial: self._repeat(trial))
            self.optuna = optuna.create_study(
                storage=self._storage,
                study_name=scenario.name,
                directions=directions,
                sampler=sampler,
                load_if_exists=True,
            )
            if self.optuna.directions != directions:
                raise ConfigurationError(f"study {scenario.name!r}: the stored one has other objectives")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ExperimentalWarning)
                if self.optuna.metric_names is None:  # dashboards show the names
                    self.optuna.set_metric_names([objective.name for objective in scenario.objectives])
            if storage:
                self._check_scenario()
                sampler.reseed_rng()  # other processes have the same seed
            elif scenario.optimiser in _SAMPLERS_WITH_STATE and (count := len(self.optuna.get_trials(deepcopy=False))):
                self.optuna.sampler = make_sampler(replace(scenario, seed=scenario.seed + count))

    @classmethod
    def create(cls, scenario: Scenario, folder: Path, storage: str = "") -> LearningStudy:
        """Creates a study; joins the one of this scenario if it is in a database.

        :raises Refused: the folder has one already, which is not in a database or of another scenario.
        """
        stored = scenario.derived()
        if (folder / SCENARIO_FILE).exists():
            if not storage:
                raise Refused(f"{folder} has a study already; resume it, or name another folder")
            differing = _differing(_shared(load_scenario(folder / SCENARIO_FILE, is_stored=True)), _shared(stored))
            if differing:
                raise Refused(f"{folder} has a study of another scenario: different {', '.join(differing)}")
        make_sampler(scenario)  # a mistake leaves no folder
        folder.mkdir(parents=True, exist_ok=True)
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
        return cls(load_scenario(folder / SCENARIO_FILE, is_stored=True), folder, storage)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Inside the `with` block, no other process may run this study from its folder, unless it is in a database.

        :raises Refused: another process runs it.
        """
        if self._url:
            yield
            return
        with open(self.folder / LOCK_FILE, "a", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise Refused(f"another process is running the study in {self.folder}") from None
            yield

    # -- evaluations -------------------------------------------------------------------------------------------------

    def requeue_interrupted(self) -> int:
        """Lets `ask` return the evaluations that were running when an earlier run ended, with their numbers and seeds.
        Returns how many these are.

        Only if no other process runs the study: the trials of a database may be running on other machines.
        """
        lost, is_over = self._trials(TrialState.RUNNING), _is_over(self)
        for trial in lost:
            if is_over or _RESULT in trial.user_attrs or configuration_problems(self.scenario.variables, trial.params):
                self._reliably(lambda each=trial: self._end_interrupted(each))  # type: ignore[misc]
            else:
                self._interrupted.append(trial.number)
        return len(lost)

    def release(self) -> None:
        """Lets other processes repeat the evaluations that `ask` has returned and that have no result. In a folder, the
        next run does."""
        if not self._url:
            self._asked.clear()
        for number in list(self._asked):
            trial = self._asked.pop(number)
            with suppress(StorageFailed), storing(self.folder, self._url):
                self._end_interrupted(self.optuna.get_trials(deepcopy=False)[trial.number])

    def save_unsaved(self) -> int:
        """Stores results that an earlier run could not store. Returns their number."""
        count = 0
        for file in sorted(self.folder.glob(UNSAVED_FILES)):
            for line in file.read_text(encoding="utf-8").splitlines():
                try:
                    data = json.loads(line)
                except ValueError:  # the disk was full
                    continue
                number, result = int(data["number"]), Evaluation.from_json(data["result"])
                states = {trial.number: trial.state for trial in self._trials(*TrialState)}
                if states.get(number) is TrialState.RUNNING:
                    self._asked[number] = self._trial(number)
                    self.tell(number, result)
                    count += 1
            file.unlink()
        return count

    def beat(self) -> None:
        """Reports to the database that the evaluations of this process are running, and lets those of processes that
        have died be repeated. To be called at least every few seconds."""
        if not self._url or time.monotonic() - self._beaten < HEARTBEAT:
            return
        self._beaten = time.monotonic()
        self._reliably(lambda: repeat_stale(self.optuna))
        for number in self._asked:
            self._reliably(lambda each=number: self._beat(each))  # type: ignore[misc]

    def enqueue(self, configuration: dict[str, Value], seed: int | None = None) -> None:
        """Evaluates a configuration next.

        :param seed: of its draws; None for those of its number.
        """
        attributes = {} if seed is None else {_SEED: seed}
        self.optuna.enqueue_trial(dict(configuration), user_attrs=attributes, skip_if_exists=True)

    def ask(self) -> tuple[int, dict[str, Value], int]:
        """Returns number, configuration and seed of the next evaluation."""
        return self._reliably(self._ask)

    def _ask(self) -> tuple[int, dict[str, Value], int]:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Heartbeat of storage")  # `beat` does what Study.optimize would
            trial = (
                self._trial(self._interrupted.pop(0))
                if self._interrupted
                else _draw(self.optuna, self._distributions, self.scenario)
            )
        if self._url:
            self._beat(trial.number)
        self._asked[trial.number] = trial
        seed = trial.user_attrs.get(_SEED)
        if seed is None:
            seed = seed_of(self.scenario, trial.number)
            trial.set_user_attr(_SEED, seed)
        return trial.number, dict(trial.params), int(seed)

    def tell(self, number: int, result: Evaluation) -> None:
        """Stores the result of an evaluation that `ask` has returned.

        :raises StorageFailed: it cannot be stored. It is kept as by `keep`.
        """
        trial = self._asked.pop(number)
        try:
            self._reliably(lambda: self._store(trial, result))
        except StorageFailed:
            self.keep(number, result)
            raise

    def keep(self, number: int, result: Evaluation) -> None:
        """Writes a result that cannot be stored to a file of the folder, for `save_unsaved` of the next run. If that
        fails too, the next run repeats the evaluation, with the same result."""
        self._asked.pop(number, None)
        file = self.folder / UNSAVED_FILES.replace("*", str(os.getpid()))
        try:
            with open(file, "a", encoding="utf-8") as lines:
                lines.write(json.dumps({"number": number, "result": result.to_json()}) + "\n")
        except OSError as error:
            log.warning("evaluation %d will be repeated: %s: %s", number, file, error.strerror)

    def _store(self, trial: Trial, result: Evaluation) -> None:
        trial.set_user_attr(_RESULT, json.dumps(result.to_json()))
        if result.error:
            trial.set_user_attr(_ERROR, result.error)
            self.optuna.tell(trial, state=TrialState.FAIL, skip_if_finished=True)
            return
        for name, violation in result.violations.items():
            trial.set_constraint(name, violation)
        names = [objective.name for objective in self.scenario.objectives]
        trial.set_user_attr(REPETITIONS, [len(result.repetitions), _variances(result, names)])
        trial.set_user_attr(SUCCESS_RATE, result.success_rate)
        self.optuna.tell(trial, [result.objectives[name] for name in names], skip_if_finished=True)

    @property
    def counted(self) -> int:
        """Number of evaluations that use up the budget: ended ones, broken ones included."""
        return sum(_RESULT in trial.user_attrs for trial in self._trials(TrialState.COMPLETE, TrialState.FAIL))

    @property
    def running_count(self) -> int:
        """Number of evaluations that are running, on all machines, or have been interrupted."""
        return len(self._trials(TrialState.RUNNING)) - len(self._interrupted)

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

    def best(self, results: Mapping[int, Evaluation] | None = None) -> list[int]:
        """Returns the numbers of the Pareto-optimal evaluations, those with the best success rate first. Truncated ones
        are among them only if no other is: their means are of fewer repetitions.

        :param results: only of these, since other processes add some meanwhile; None for all.
        """
        results = self.results() if results is None else results
        return ranked(self.scenario, pareto_optimal(self.scenario, results), results)

    def ranked(self) -> list[int]:
        """Returns the numbers of all evaluations with a result: by success rate, then by the objectives in their
        order; the best one first."""
        results = self.results()
        return ranked(self.scenario, [number for number, result in results.items() if not result.error], results)

    def attribute(self, name: str) -> object:
        """Returns plain data that `set_attribute` has stored with the study; None if there are none."""
        return self._reliably(lambda: self.optuna.user_attrs).get(name)

    def set_attribute(self, name: str, value: object) -> None:
        """Stores plain data with the study."""
        self._reliably(lambda: self.optuna.set_user_attr(name, value))

    # -- internal ----------------------------------------------------------------------------------------------------

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return self._reliably(lambda: self.optuna.get_trials(deepcopy=False, states=states))

    def _trial(self, number: int) -> Trial:
        storage = self._storage
        study = storage.get_study_id_from_name(self.scenario.name)
        return Trial(self.optuna, storage.get_trial_id_from_study_id_trial_number(study, number))

    def _beat(self, number: int) -> None:
        storage = self._storage
        if isinstance(storage, RDBStorage):
            study = storage.get_study_id_from_name(self.scenario.name)
            storage.record_heartbeat(storage.get_trial_id_from_study_id_trial_number(study, number))

    def _end_interrupted(self, trial: FrozenTrial) -> None:
        """Ends an evaluation that was running: with its stored result, else by a repetition, if the budget allows."""
        if _RESULT in trial.user_attrs:
            self._store(self._trial(trial.number), _result_of(trial))
            return
        if not _is_over(self):
            self._repeat(trial)
        self.optuna.tell(trial.number, state=TrialState.FAIL, skip_if_finished=True)

    def _repeat(self, trial: FrozenTrial) -> None:
        attributes = {_SEED: trial.user_attrs.get(_SEED, seed_of(self.scenario, trial.number))}
        self.optuna.enqueue_trial(trial.params, user_attrs=attributes)

    def _check_scenario(self) -> None:
        """Checks that the study in the database is of this scenario."""
        own = _shared(self.scenario)
        stored = self.optuna.user_attrs.get(_SCENARIO)
        if stored is None:
            self.optuna.set_user_attr(_SCENARIO, own)
        elif differing := _differing(stored, own):
            raise ConfigurationError(
                f"study {self.scenario.name!r} in {public_name(self._url)} is of another scenario: different "
                f"{', '.join(differing)}; give this one another name"
            )

    def _reliably(self, work: Callable[[], T]) -> T:
        return _reliably(self.folder, self._url, work)


def _is_over(study: LearningStudy) -> bool:
    """Whether the budget is used up."""
    return study.counted >= study.scenario.budget.evaluations


def _variances(result: Evaluation, names: Sequence[str]) -> list[float]:
    """Returns the variance of each objective over the repetitions; 0 for a single one."""
    found = [[each.objectives[name] for each in result.repetitions] for name in names]
    return [variance(each) if len(each) > 1 else 0.0 for each in found]


def _reliably(folder: Path, url: str, work: Callable[[], T]) -> T:
    """Calls what reads or writes the storage; again for a while if a database does not answer."""
    deadline = 0.0
    while True:
        try:
            with storing(folder, url):
                return work()
        except StorageFailed as failure:
            if not url or (deadline and time.monotonic() > deadline):
                raise
            if not deadline:
                log.warning("%s; trying again for %g s", failure, RECONNECT_TIMEOUT)
                deadline = time.monotonic() + RECONNECT_TIMEOUT
        time.sleep(min(_RECONNECT_PERIOD, RECONNECT_TIMEOUT))


def _draw(study: optuna.Study, distributions: Mapping[str, BaseDistribution], scenario: Scenario) -> Trial:
    """Returns a new trial that satisfies the restrictions: others are pruned."""
    for _ in range(_DRAWS):
        trial = _asked(study, distributions, scenario)
        if scenario.allows(trial.params):
            return trial
        study.tell(trial, state=TrialState.PRUNED)
    raise Refused(f"optimiser {scenario.optimiser}: of {_DRAWS} configurations none satisfies the restrictions")


def _asked(study: optuna.Study, distributions: Mapping[str, BaseDistribution], scenario: Scenario) -> Trial:
    """Returns a new trial with values of the variables that exist beside each other."""
    if not any(each.only_if for each in scenario.variables):
        return study.ask(dict(distributions))
    trial = study.ask()
    for variable in scenario.variables:
        if variable.exists(trial.params):
            _suggest(trial, variable)
    return trial


def _suggest(trial: Trial, variable: Variable) -> None:
    """Gives a trial a value of a variable."""
    low, high, log_scale = variable.low, variable.high, variable.scale == "log"
    if variable.kind == "real":
        trial.suggest_float(variable.name, low, high, log=log_scale)
    elif variable.kind == "integer":
        trial.suggest_int(variable.name, round(low), round(high), log=log_scale)
    else:
        trial.suggest_categorical(variable.name, variable.values)


def _shared(scenario: Scenario) -> dict[str, object]:
    """Returns the part of a scenario that is the same for all processes that run its study."""
    data = read_yaml(scenario.source)
    kept = {key: value for key, value in data.items() if key not in _LOCAL_KEYS}
    shared: dict[str, object] = json.loads(json.dumps(kept))
    return shared


def _differing(one: dict[str, object], other: dict[str, object]) -> list[str]:
    return sorted(key for key in one.keys() | other.keys() if one.get(key) != other.get(key))


def _result_of(trial: FrozenTrial) -> Evaluation:
    return Evaluation.from_json(json.loads(trial.user_attrs[_RESULT]))


def _ranges(numbers: list[int]) -> str:
    return f"{len(numbers)} results from {numbers[0]} to {numbers[-1]}" if numbers else "none"
