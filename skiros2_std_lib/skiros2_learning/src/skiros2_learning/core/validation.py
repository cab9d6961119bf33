"""Validation of a study: its best configurations are repeated on draws that the search has not seen.

The best of many results had luck, also the best of a few that are repeated. So one set of draws chooses a
configuration, by a lower confidence bound, and another one gives the numbers that are reported. The skill's defaults
run on the same draws: a configuration that is not better than they are, with confidence, is not applied.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from skiros2_common.core.errors import Refused
from skiros2_learning.core.evaluation import (
    Evaluation,
    Execution,
    Outcome,
    Repetition,
    find_defaults,
    repeat_once,
    seed_of,
)
from skiros2_learning.core.intervals import (
    LEVEL,
    Interval,
    difference_sign,
    mean_interval,
    share_interval,
)
from skiros2_learning.core.objectives import Objective
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.variables import Value

#: The numbers that the seeds are made of: no study has as many evaluations.
_CHOICE_NUMBER, _PROOF_NUMBER = 500_000, 500_001
#: Attribute of the study.
_VALIDATION = "validation"
#: Outcomes of a validation that is not finished, one in each line.
UNFINISHED_FILE = "validation.jsonl"
#: Repetitions of the candidates between two looks at them.
_ROUND = 2
DEFAULTS = "the defaults of the skill"


@dataclass(frozen=True)
class Execute:
    """An execution to be made: configuration, seed, index of the repetition; values of the features, if they are not
    those of the scenario."""

    configuration: dict[str, Value]
    seed: int
    index: int
    variation: Mapping[str, float] | None = None

    def scenario(self, scenario: Scenario) -> Scenario:
        """Returns the scenario with the variation."""
        return scenario if self.variation is None else replace(scenario, variation=self.variation)


#: Makes executions. Yields their outcomes in the same order.
Repeat = Callable[[Scenario, Sequence[Execute]], Iterator[Outcome]]


@dataclass(frozen=True)
class Sample:
    """The repetitions of one configuration on new draws.

    :param number: of the evaluation of the search; None for the skill's defaults.
    :param outcomes: by index of the repetition. One that broke counts as failed.
    :param title: names it, if it is not that of an evaluation or the defaults.
    """

    number: int | None
    configuration: dict[str, Value]
    seed: int
    outcomes: tuple[Outcome, ...]
    title: str = ""

    @property
    def name(self) -> str:
        """Names the configuration for people."""
        if self.title:
            return self.title
        return DEFAULTS if self.number is None else f"evaluation {self.number}"

    @property
    def count(self) -> int:
        return len(self.outcomes)

    @property
    def repetitions(self) -> list[Repetition]:
        """Those that did not break."""
        return [each for each in self.outcomes if not isinstance(each, str)]

    @property
    def broken(self) -> list[str]:
        """Why repetitions broke."""
        return [each for each in self.outcomes if isinstance(each, str)]

    @property
    def good(self) -> int:
        """Number of successes."""
        return sum(each.is_success for each in self.repetitions)

    @property
    def success(self) -> Interval:
        """Share of successes, with its interval."""
        return share_interval(self.good, self.count)

    def objective(self, name: str) -> Interval:
        """Returns the mean of an objective over the repetitions that did not break, with its interval."""
        return mean_interval([each.objectives[name] for each in self.repetitions])

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        outcomes = [each if isinstance(each, str) else asdict(each) for each in self.outcomes]
        parts = {"number": self.number, "configuration": self.configuration, "seed": self.seed, "title": self.title}
        return {**parts, "outcomes": outcomes}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Sample:
        """The inverse of `to_json`."""
        outcomes = tuple(each if isinstance(each, str) else Repetition(**each) for each in data["outcomes"])
        return cls(data["number"], dict(data["configuration"]), data["seed"], outcomes, data.get("title", ""))


@dataclass(frozen=True)
class Validation:
    """A validated study.

    :param counted: evaluations that the study had.
    :param candidates: the repetitions by which one was chosen, the best one of the search first; fewer of those that
        could no longer win. None if there was only one candidate.
    :param learned: the repetitions of the chosen one, on other draws.
    :param defaults: those of the skill's defaults, on the same draws; None if it has none for some variable.
    :param advantage: what the learned one is better in than the defaults, with confidence: `success`, the name of an
        objective, or "" if it is not better.
    """

    counted: int
    candidates: tuple[Sample, ...]
    learned: Sample
    defaults: Sample | None
    advantage: str

    @property
    def is_better(self) -> bool:
        """Whether the learned configuration may be applied: it has succeeded, and is better than the defaults."""
        return self.learned.good > 0 and (self.defaults is None or bool(self.advantage))

    @property
    def decided(self) -> Sample:
        """The learned configuration if it may replace the defaults, else the defaults."""
        return self.learned if self.defaults is None or self.advantage else self.defaults

    @property
    def verdict(self) -> str:
        """The decision, for people."""
        if self.defaults is None and not self.learned.good:
            return f"chosen: none; {self.learned.name} has never succeeded, and the skill has no defaults"
        if self.defaults is None:
            return f"chosen: {self.learned.name}; the skill has no defaults to compare with"
        if self.advantage:
            return f"chosen: {self.learned.name}, better than {DEFAULTS} in {self.advantage} with confidence"
        return f"chosen: {DEFAULTS}; {self.learned.name} is not better with confidence"

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "counted": self.counted,
            "candidates": [each.to_json() for each in self.candidates],
            "learned": self.learned.to_json(),
            "defaults": None if self.defaults is None else self.defaults.to_json(),
            "advantage": self.advantage,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Validation:
        """The inverse of `to_json`."""
        return cls(
            data["counted"],
            tuple(map(Sample.from_json, data["candidates"])),
            Sample.from_json(data["learned"]),
            None if data["defaults"] is None else Sample.from_json(data["defaults"]),
            data["advantage"],
        )


def validate(study: LearningStudy, repeat: Repeat) -> Validation:
    """Validates a study, and stores the result with it. Executions of an interrupted validation are not made again.

    :raises Refused: the study has no results.
    """
    scenario, results = study.scenario, study.results()
    plan = scenario.validation
    numbers: list[int] = []
    for number in (each for each in study.ranked() if each in results):
        if all(results[number].configuration != results[each].configuration for each in numbers):
            numbers.append(number)
        if len(numbers) == plan.candidates:
            break
    if not numbers:
        raise Refused(f"the study in {study.folder} has no results to validate")
    executions = _Executions(study, repeat)
    chosen: int | None = numbers[0]
    candidates: list[Sample] = []
    if len(numbers) > 1:
        seed = seed_of(scenario, _CHOICE_NUMBER)
        started = {number: Sample(number, results[number].configuration, seed, ()) for number in numbers}
        chosen, candidates = _raced(scenario.objectives, started, plan.choice, executions)
    assert chosen is not None
    seed = seed_of(scenario, _PROOF_NUMBER)
    compared = [Sample(chosen, results[chosen].configuration, seed, ())]
    if defaults := find_defaults(scenario):
        compared.append(Sample(None, defaults, seed, ()))
    learned, *usual = executions.continued(compared, plan.repetitions)
    advantage = advantage_of(scenario.objectives, learned, usual[0]) if usual else ""
    found = Validation(len(results), tuple(candidates), learned, usual[0] if usual else None, advantage)
    study.set_attribute(_VALIDATION, found.to_json())
    executions.file.unlink(missing_ok=True)
    return found


class _Executions:
    """The executions of a validation. Each outcome is kept in a file of the study until the validation is stored."""

    def __init__(self, study: LearningStudy, repeat: Repeat) -> None:
        self._scenario = study.scenario
        self._repeat = repeat
        self.file = study.folder / UNFINISHED_FILE
        self._known: dict[str, Outcome] = {}
        lines = self.file.read_text(encoding="utf-8").splitlines() if self.file.exists() else []
        for line in lines:
            with suppress(ValueError):  # the last line, if the process was killed
                key, outcome = json.loads(line)
                self._known[key] = outcome if isinstance(outcome, str) else Repetition(**outcome)

    def continued(self, samples: Sequence[Sample], count: int) -> list[Sample]:
        """Repeats the configurations of samples until each has `count` repetitions."""
        wanted = [[Execute(each.configuration, each.seed, index) for index in range(count)] for each in samples]
        new = [job for jobs in wanted for job in jobs if _key(job) not in self._known]
        with open(self.file, "a", encoding="utf-8") as file:
            for job, outcome in zip(new, self._repeat(self._scenario, new), strict=True):
                self._known[_key(job)] = outcome
                data = outcome if isinstance(outcome, str) else asdict(outcome)
                file.write(json.dumps([_key(job), data]) + "\n")
                file.flush()
        found = [tuple(self._known[_key(job)] for job in jobs) for jobs in wanted]
        return [replace(each, outcomes=outcomes) for each, outcomes in zip(samples, found, strict=True)]


def _raced(
    objectives: Sequence[Objective], samples: Mapping[int, Sample], count: int, executions: _Executions
) -> tuple[int, list[Sample]]:
    """Chooses among candidates: round by round, those that cannot win any more are not repeated, nor a last one. The
    choice is the one after `count` repetitions of each.

    :returns: the number of the chosen one, and all samples.
    """
    found, racing, done = dict(samples), list(samples), 0
    while done < count and len(racing) > 1:
        done = min(count, done + _ROUND)
        found |= zip(racing, executions.continued([found[number] for number in racing], done), strict=True)
        best = max(found[number].good for number in racing)
        racing = [number for number in racing if found[number].good + count - done >= best]
    return min(racing, key=lambda number: caution(objectives, found[number])), list(found.values())


def _key(job: Execute) -> str:
    return json.dumps([job.configuration, job.seed, job.index], sort_keys=True)


def stored_validation(study: LearningStudy) -> Validation | None:
    """Returns the last validation of a study; None if it has none."""
    data = study.attribute(_VALIDATION)
    return Validation.from_json(data) if isinstance(data, Mapping) else None


def applicable(
    study: LearningStudy, number: int | None = None, unvalidated: bool = False
) -> tuple[int, Evaluation, Sample | None]:
    """Returns the evaluation to apply, with its validation.

    :param number: of the evaluation; None for the one that was chosen.
    :param unvalidated: whether to take one that is not validated, or not better than the defaults.
    :raises Refused: it is not validated, not better than the defaults, or has never succeeded.
    :raises UnknownName: there is no such evaluation.
    """
    found, hint = stored_validation(study), "--unvalidated applies it all the same"
    if number is not None:
        result = study.result(number)
        sample = found.learned if found is not None and found.learned.number == number else None
        if unvalidated:
            return number, result, sample
    if found is None:
        raise Refused(f"study {study.scenario.name!r} is not validated; run: learn validate {study.folder}; or {hint}")
    chosen = found.learned.number
    assert chosen is not None
    if number not in (None, chosen):
        raise Refused(f"evaluation {number} is not validated; validated is {chosen}; {hint}")
    if not found.is_better and not unvalidated:
        text = f"evaluation {chosen} ({share_text(found.learned)})"
        if found.defaults is None:
            raise Refused(f"{text} has never succeeded, and is not applied; {hint}")
        text += f" is not better with confidence than {DEFAULTS} ({share_text(found.defaults)})"
        raise Refused(f"{text}, and is not applied; {hint}")
    return chosen, study.result(chosen), found.learned


def repeat_here(execution: Execution | None = None) -> Repeat:
    """Returns a function that makes executions in this process, one at a time.

    :param execution: instead of the scenario's.
    """

    def repeat(scenario: Scenario, jobs: Sequence[Execute]) -> Iterator[Outcome]:
        for each in jobs:
            yield repeat_once(each.scenario(scenario), each.configuration, each.seed, each.index, execution)

    return repeat


def share_text(sample: Sample) -> str:
    """Describes the success of a sample: `28 of 30, 95 % interval 79 to 98 %`."""
    interval = sample.success
    text = f"{sample.good} of {sample.count}, {LEVEL * 100:.0f} % interval"
    text += f" {interval.low * 100:.0f} to {interval.high * 100:.0f} %"
    if sample.broken:
        text += f" ({len(sample.broken)} broken, such as: {sample.broken[0]})"
    return text


def sample_text(objectives: Sequence[Objective], sample: Sample) -> str:
    """Describes a sample in one line: success, objectives with their intervals."""
    parts = [f"success {share_text(sample)}"]
    for objective in objectives:
        found = sample.objective(objective.name)
        parts.append(f"{objective.name} {found.estimate:.3g} ({found.low:.3g} to {found.high:.3g})")
    return "; ".join(parts)


def validation_lines(scenario: Scenario, found: Validation) -> list[str]:
    """Describes a validation for people: the configurations that were compared, and the decision."""
    compared = [each for each in (found.learned, found.defaults) if each is not None]
    return [
        "validated with draws that the search has not seen:",
        *(f"  {each.name}: {sample_text(scenario.objectives, each)}" for each in compared),
        f"  {found.verdict}",
    ]


def caution(objectives: Sequence[Objective], sample: Sample) -> tuple[float, ...]:
    """Returns the cost of a sample at the bad ends of its intervals: success first, then the objectives in order."""
    costs = [-sample.success.low]
    for objective in objectives:
        found = sample.objective(objective.name)
        costs.append(found.high if objective.sense == "minimise" else -found.low)
    return tuple(cost if not math.isnan(cost) else math.inf for cost in costs)


def advantage_of(objectives: Sequence[Objective], learned: Sample, usual: Sample) -> str:
    """Returns the first of success and the objectives that differs with confidence, if the learned one is better in it.

    A configuration that has never succeeded is not better. The tests share the error: each has a part of it
    (Bonferroni).
    """
    if not learned.good:
        return ""
    level = 1.0 - (1.0 - LEVEL) / (1 + len(objectives))
    pairs = list(zip(learned.outcomes, usual.outcomes, strict=True))
    shares = [tuple(float(not isinstance(each, str) and each.is_success) for each in pair) for pair in pairs]
    sign = difference_sign([one for one, _ in shares], [other for _, other in shares], level)
    if sign:
        return "success" if sign > 0 else ""
    whole = [(a, b) for a, b in pairs if isinstance(a, Repetition) and isinstance(b, Repetition)]
    for objective in objectives:
        ones, others = ([each[side].objectives[objective.name] for each in whole] for side in (0, 1))
        sign = difference_sign(ones, others, level) * (-1 if objective.sense == "minimise" else 1)
        if sign:
            return objective.name if sign > 0 else ""
    return ""
