"""Policies as data: a table of variations with their parameters, of which the nearest row counts. A skill's start reads
it from the world model (`skiros2_skill.core.engine.learned_parameters`).

A policy is validated like a study: one set of variations that no study has seen chooses among several tables, another
one gives the numbers that are reported. The ranges of the features are those that it is validated for.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from skiros2_common.core.errors import Refused
from skiros2_learning.core.evaluation import find_defaults, seed_of
from skiros2_learning.core.policy import Policy, sampled_variations
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.validation import DEFAULTS, Execute, Repeat, Sample, Validation, advantage_of, caution
from skiros2_learning.core.variables import Value
from skiros2_learning.core.variations import Feature
from skiros2_skill.core.engine.learned_parameters import nearest_row

POLICY_FILE = "policy.json"
#: Rows of a table that a regression fills: a power of 2 covers the ranges best.
_ROWS = 32
#: The numbers that the seeds are made of: no study has as many evaluations.
_CHOICE_NUMBER, _PROOF_NUMBER = 600_000, 600_001


@dataclass(frozen=True)
class PolicyTable:
    """A policy: configurations by variation."""

    name: str
    variations: tuple[dict[str, float], ...]
    configurations: tuple[dict[str, Value], ...]

    def configuration(self, features: Sequence[Feature], variation: Mapping[str, float]) -> dict[str, Value]:
        """Returns the parameters of a variation, which may be outside of the ranges."""
        rows = [[row[each.name] for each in features] for row in self.variations]
        values = [variation[each.name] for each in features]
        widths = [each.range[1] - each.range[0] for each in features]
        return self.configurations[nearest_row(rows, values, widths)]


@dataclass(frozen=True)
class ValidatedPolicy:
    """A policy with its validation."""

    table: PolicyTable
    validation: Validation

    def save(self, folder: Path) -> None:
        """Writes it to the folder of its variations."""
        data = {"table": asdict(self.table), "validation": self.validation.to_json()}
        (folder / POLICY_FILE).write_text(json.dumps(data) + "\n", encoding="utf-8")


def stored_policy(folder: Path) -> ValidatedPolicy | None:
    """Returns the validated policy in a folder of variations; None if there is none."""
    file = folder / POLICY_FILE
    if not file.exists():
        return None
    data = json.loads(file.read_text(encoding="utf-8"))
    table = PolicyTable(data["table"]["name"], *(tuple(data["table"][k]) for k in ("variations", "configurations")))
    return ValidatedPolicy(table, Validation.from_json(data["validation"]))


def applicable_policy(folder: Path, unvalidated: bool = False) -> ValidatedPolicy:
    """Returns the policy to apply.

    :param unvalidated: whether to take one that is not better than the defaults.
    :raises Refused: there is none, it is not better than the defaults, or has never succeeded.
    """
    found = stored_policy(folder)
    if found is None:
        raise Refused(f"the variations in {folder} have no validated policy; run: learn validate {folder}")
    if not found.validation.is_better and not unvalidated:
        comparison = f"is not better with confidence than {DEFAULTS}"
        reason = "has never succeeded" if found.validation.defaults is None else comparison
        text = f"{found.table.name} {reason}, and is not applied"
        raise Refused(f"{text}; --unvalidated applies it all the same")
    return found


def policy_tables(studies: Sequence[LearningStudy]) -> list[PolicyTable]:
    """Returns the tables to choose from: predictions of a regression, the best configurations of the variations, and,
    for comparison, one configuration for all.

    :raises Refused: there are fewer than two variations with results.
    """
    policy = Policy(studies)
    features = policy.scenario.variations
    learned = [(dict(each.scenario.variation), each) for each in studies if each.ranked()]
    best = [study.result(study.ranked()[0]).configuration for _, study in learned]
    nearest = PolicyTable("the policy of the nearest variation", tuple(row for row, _ in learned), tuple(best))
    middle = {each.name: each.value_of(0.5) for each in features}
    covering = sampled_variations(features, _ROWS, policy.scenario.seed)
    predicted = tuple(policy.predict(each).configuration for each in covering)
    return [
        PolicyTable("the policy by regression", tuple(covering), predicted),
        nearest,
        PolicyTable("one configuration for all", (middle,), (nearest.configuration(features, middle),)),
    ]


def validate_policy(studies: Sequence[LearningStudy], repeat: Repeat) -> ValidatedPolicy:
    """Chooses among the tables, and validates the chosen one beside the skill's defaults. Each execution has another
    variation, drawn uniformly from the ranges.

    :raises Refused: there are fewer than two variations with results.
    """
    scenario, tables = studies[0].scenario, policy_tables(studies)
    plan, objectives = scenario.validation, scenario.objectives

    def sampled(tables: Sequence[PolicyTable], number: int, count: int) -> list[Sample]:
        seed = seed_of(scenario, number)
        drawn = _variations(scenario, seed, count)
        jobs = [
            Execute(table.configuration(scenario.variations, each), seed, index, each)
            for table in tables
            for index, each in enumerate(drawn)
        ]
        outcomes = list(repeat(scenario, jobs))
        parts = (tuple(outcomes[index * count :][:count]) for index in range(len(tables)))
        return [Sample(None, {}, seed, part, table.name) for table, part in zip(tables, parts, strict=True)]

    candidates = sampled(tables, _CHOICE_NUMBER, plan.choice)
    costs = [caution(objectives, each) for each in candidates]
    compared = [tables[costs.index(min(costs))]]
    if defaults := find_defaults(scenario):
        compared.append(PolicyTable(DEFAULTS, compared[0].variations[:1], (defaults,)))
    learned, *usual = sampled(compared, _PROOF_NUMBER, plan.repetitions)
    advantage = advantage_of(objectives, learned, usual[0]) if usual else ""
    counted = sum(each.counted for each in studies)
    found = Validation(counted, tuple(candidates), learned, usual[0] if usual else None, advantage)
    return ValidatedPolicy(compared[0], found)


def _variations(scenario: Scenario, seed: int, count: int) -> list[dict[str, float]]:
    units = np.random.default_rng(seed).random((count, len(scenario.variations)))
    named = [zip(scenario.variations, row, strict=True) for row in units]
    return [{each.name: each.value_of(float(unit)) for each, unit in row} for row in named]
