"""One evaluation: scenario, configuration and seed give objective values, always the same ones."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError, WrongValue
from skiros2_learning.core.episode_record import EpisodeRecord
from skiros2_learning.core.randomisation import Quantity
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.variables import Value, configuration_problems

#: Runs one execution: scenario, configuration, seed of the evaluation, index of the repetition.
Execution = Callable[[Scenario, Mapping[str, Value], int, int], EpisodeRecord]


@dataclass(frozen=True)
class Repetition:
    """The result of one execution.

    :param objectives, constraints: values by name; of constraints, the value of their reward.
    :param rewards: value of each reward, by OBJECTIVE.NAME.
    :param is_success: whether the task and all criteria of success hold.
    :param reason: why the task did not succeed; "" if it did.
    :param duration: simulated time (s).
    """

    objectives: dict[str, float]
    constraints: dict[str, float]
    rewards: dict[str, float]
    is_success: bool
    reason: str
    duration: float


#: A repetition, or why it has no result.
Outcome = Repetition | str


@dataclass(frozen=True)
class Evaluation:
    """The result of an evaluation.

    :param objectives: mean of the repetitions that were made, by name.
    :param violations: mean violation of each constraint; 0 or less if it holds.
    :param success_rate: successes as a fraction of the planned repetitions: those that were not made count as failed.
    :param error: why there is no result, such as a crash; "" if there is one.
    :param planned: number of repetitions of a complete evaluation; 0 if it is not known (studies of earlier versions).
    """

    configuration: dict[str, Value]
    seed: int
    objectives: dict[str, float] = field(default_factory=dict)
    violations: dict[str, float] = field(default_factory=dict)
    success_rate: float = 0.0
    repetitions: list[Repetition] = field(default_factory=list)
    error: str = ""
    planned: int = 0

    @property
    def good(self) -> int:
        """Number of repetitions that succeeded."""
        return sum(each.is_success for each in self.repetitions)

    @property
    def is_truncated(self) -> bool:
        """Whether the evaluation ended before its last repetition, because too many had failed."""
        return len(self.repetitions) < self.planned

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Evaluation:
        """The inverse of `to_json`."""
        return cls(**{**data, "repetitions": [Repetition(**each) for each in data["repetitions"]]})


class Unavailable(Refused):
    """An execution cannot be made now, whatever the configuration: the run ends, and the evaluation is repeated."""

    code = "unavailable"


def evaluate(
    scenario: Scenario, configuration: Mapping[str, Value], seed: int, execution: Execution | None = None
) -> Evaluation:
    """Runs all repetitions of a configuration, or until too many have failed. An execution that breaks is a result with
    a reason.

    :param execution: instead of the scenario's.
    :raises WrongValue: the configuration does not fit the scenario.
    :raises ConfigurationError: the scenario names an execution that does not exist.
    :raises Unavailable: by the execution.
    """
    chosen = dict(configuration)
    problems = configuration_problems(scenario.variables, chosen)
    if problems:
        raise WrongValue("; ".join(problems))
    execution = execution or find_execution(scenario.execution)
    repetitions: list[Repetition] = []
    for index in range(scenario.repetitions):
        outcome = repeat_once(scenario, chosen, seed, index, execution)
        if isinstance(outcome, str):
            error = f"repetition {index}: {outcome}"
            return Evaluation(chosen, seed, repetitions=repetitions, error=error, planned=scenario.repetitions)
        repetitions.append(outcome)
        if sum(not each.is_success for each in repetitions) >= scenario.max_failures:
            break
    return summary(scenario, chosen, seed, repetitions)


def repeat_once(
    scenario: Scenario, configuration: Mapping[str, Value], seed: int, index: int, execution: Execution | None = None
) -> Outcome:
    """Runs one repetition. An execution that breaks gives the reason, as a text.

    :param execution: instead of the scenario's.
    :raises ConfigurationError: the scenario names an execution that does not exist.
    :raises Unavailable: by the execution.
    """
    execution = execution or find_execution(scenario.execution)
    try:
        return judge(scenario, execution(scenario, configuration, seed, index))
    except Unavailable:
        raise
    except SkirosError as error:
        return str(error)
    except Exception as error:  # of a skill library, a plug-in or the physics
        return f"{type(error).__name__}: {error}"


def judge(scenario: Scenario, record: EpisodeRecord) -> Repetition:
    """Computes the rewards of one execution.

    :raises WrongValue: a reward is not a finite number.
    """
    rewards: dict[str, float] = {}
    objectives: dict[str, float] = {}
    for objective in scenario.objectives:
        total = 0.0
        for part in objective.rewards:
            value = _finite(part.reward(record), f"{objective.name}.{part.name}")
            rewards[f"{objective.name}.{part.name}"] = value
            total += part.weight * value
        objectives[objective.name] = total
    constraints = {each.name: _finite(each.reward(record), each.name) for each in scenario.constraints}
    is_success = record.succeeded and all(
        each.violation(_finite(each.reward(record), each.name)) <= 0.0 for each in scenario.success
    )
    return Repetition(objectives, constraints, rewards, is_success, record.reason, record.duration)


def summary(
    scenario: Scenario, configuration: Mapping[str, Value], seed: int, repetitions: Sequence[Repetition]
) -> Evaluation:
    """Averages the repetitions of an evaluation."""
    count = len(repetitions)
    return Evaluation(
        dict(configuration),
        seed,
        {o.name: math.fsum(r.objectives[o.name] for r in repetitions) / count for o in scenario.objectives},
        {
            each.name: math.fsum(each.violation(r.constraints[each.name]) for r in repetitions) / count
            for each in scenario.constraints
        },
        sum(r.is_success for r in repetitions) / scenario.repetitions,
        list(repetitions),
        planned=scenario.repetitions,
    )


def find_execution(name: str) -> Execution:
    """Returns the function `module:function`.

    :raises ConfigurationError: there is none.
    """
    module, _, function = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), function, None)
    except ImportError as error:
        raise ConfigurationError(f"execution {name!r}: {error}") from None
    if not callable(found):
        raise ConfigurationError(f"execution {name!r}: expected module:function, such as a.b:run_episode")
    execution: Execution = found
    return execution


def check_execution(scenario: Scenario) -> None:
    """Checks a scenario against the scene and the skills of its execution: by `check_scenario(scenario)` in the module
    of the execution, if there is one. Nothing is simulated.

    :raises ConfigurationError: the text names all problems; a `ScenarioError` has their lines.
    """
    module = importlib.import_module(find_execution(scenario.execution).__module__)
    check = getattr(module, "check_scenario", None)
    if check is not None:
        check(scenario)


def find_quantities(scenario: Scenario) -> list[Quantity]:
    """Returns what differs between the executions: by `randomised_quantities(scenario)` in the module of the execution;
    [] without such a function.

    :raises SkirosError: the scenario does not fit the scene.
    """
    module = importlib.import_module(find_execution(scenario.execution).__module__)
    found = getattr(module, "randomised_quantities", None)
    return list(found(scenario)) if found is not None else []


def find_defaults(scenario: Scenario) -> dict[str, Value]:
    """Returns the values that the skills have by default for the variables: by `default_configuration(scenario)` in the
    module of the execution. {} without such a function, or if a variable has no default."""
    module = importlib.import_module(find_execution(scenario.execution).__module__)
    defaults = getattr(module, "default_configuration", None)
    return dict(defaults(scenario)) if defaults is not None else {}


def seed_of(scenario: Scenario, number: int) -> int:
    """Returns the seed of an evaluation of a study: each evaluation has other draws of the randomisation."""
    return scenario.seed * 1_000_003 + number


def _finite(value: float, name: str) -> float:
    if not math.isfinite(value):
        raise WrongValue(f"reward {name} is {value}, expected a finite number")
    return float(value)
