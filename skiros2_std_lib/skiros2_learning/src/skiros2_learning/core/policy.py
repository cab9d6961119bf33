"""Variations of a task: good parameters as functions of features of the task, such as the position of the goal.

Each sampled variation has a study of its own, which starts from that of the nearest variation before it. A surrogate
over features and parameters, fitted to all evaluations, predicts the parameters of a variation that was not learned.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_learning.core.earlier_studies import with_earlier
from skiros2_learning.core.samplers import distribution_of
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.search_space import Array, SearchSpace
from skiros2_learning.core.study import LearningStudy
from skiros2_learning.core.surrogate import fit_surrogate
from skiros2_learning.core.variables import Value
from skiros2_learning.core.variations import Feature

#: Number of candidates around each good configuration, their spread (fraction of the range), and uniform candidates.
_AROUND, _SPREADS, _UNIFORM = 20, (0.08, 0.03, 0.01), 1000
_CENTRES = 20


@dataclass(frozen=True)
class Prediction:
    """The predicted parameters of a variation.

    :param success: predicted success rate, 0 to 1.
    :param deviation: its standard deviation.
    """

    configuration: dict[str, Value]
    success: float
    deviation: float


def sampled_variations(features: Sequence[Feature], count: int, seed: int) -> list[dict[str, float]]:
    """Returns variations that cover the ranges of the features (Sobol sequence).

    :param count: a power of 2 covers them best.
    """
    units = qmc.Sobol(len(features), seed=seed).random_base2(max(1, (count - 1).bit_length()))[:count]
    return [{each.name: each.value_of(float(unit)) for each, unit in zip(features, row, strict=True)} for row in units]


def learn_variations(
    scenario: Scenario, folder: Path, count: int, run: Callable[[LearningStudy], None]
) -> list[LearningStudy]:
    """Learns sampled variations one after another. Variations that a former run has begun are continued.

    :param folder: for a folder of each study, `variation_N`.
    :param run: runs a study until its budget is used up.
    :raises Refused: the scenario has no variations.
    """
    if not scenario.variations:
        raise Refused(f"scenario {scenario.name} has no variations; add them: docs/learning.md, Variations")
    if conditional := [each.name for each in scenario.variables if each.only_if]:
        raise Refused(f"policies need variables that always exist; conditional: {', '.join(conditional)}")
    studies: list[LearningStudy] = []
    for number, variation in enumerate(sampled_variations(scenario.variations, count, scenario.seed)):
        target = folder / f"variation_{number}"
        if target.exists():
            study = LearningStudy.open(target)
        else:
            plan = scenario.derived(variation=variation, seed=scenario.seed + number)
            first: list[dict[str, Value]] = []
            near = sorted(studies, key=lambda each: _distance(scenario, variation, each.scenario.variation))[:1]
            if near:
                plan, first = with_earlier(plan, near)
            study = LearningStudy.create(plan, target)
            for configuration in first:
                study.enqueue(configuration)
        run(study)
        studies.append(study)
    return studies


def has_variations(folder: Path) -> bool:
    """Whether a folder is one of `learn variations`."""
    return any(folder.glob("variation_*"))


def variation_studies(folder: Path) -> list[LearningStudy]:
    """Opens the studies of the variations in a folder.

    :raises UnknownName: there are none.
    """
    found = sorted(folder.glob("variation_*"), key=lambda each: int(each.name.rpartition("_")[2]))
    if not found:
        raise UnknownName(f"{folder} has no variations; learn them: learn variations SCENARIO --study {folder}")
    return [LearningStudy.open(each) for each in found]


class Policy:
    """Predicts good parameters from the features of a task. Reproducible: it depends on the studies only.

    :param studies: of the same scenario with different variations.
    :raises Refused: there are fewer than two variations with results.
    """

    def __init__(self, studies: Sequence[LearningStudy]) -> None:
        pairs = [
            (study.scenario.variation, result)
            for study in studies
            for result in study.results().values()
            if not result.error
        ]
        if len({tuple(variation.values()) for variation, _ in pairs}) < 2:
            raise Refused("the policy needs results of at least two variations")
        self.scenario = studies[0].scenario
        self._space = SearchSpace({v.name: distribution_of(v) for v in self.scenario.variables}, {})
        self._points = self._space.points([SimpleNamespace(params=result.configuration) for _, result in pairs])
        results = [result for _, result in pairs]
        objective = self.scenario.objectives[0]
        sign = 1.0 if objective.sense == "maximise" else -1.0
        self._values = sign * np.array([result.objectives[objective.name] for result in results])
        context = np.array([self._units(variation) for variation, _ in pairs])
        inputs = np.hstack([context, self._points])
        nominal = [False] * context.shape[1] + self._space.nominal
        random = np.random.default_rng(self.scenario.seed)
        rates = np.array([result.success_rate for result in results])
        with threadpool_limits(1):  # the matrices are small: threads would cost more than they bring
            self._objective = fit_surrogate(inputs, self._values, random, nominal=nominal)
            self._success = fit_surrogate(inputs, rates, random, nominal=nominal)
            self._violations = [
                (fit_surrogate(inputs, violations, random, nominal=nominal), float(np.abs(violations).max()) or 1.0)
                for name in (each.name for each in self.scenario.constraints)
                for violations in [np.array([result.violations[name] for result in results])]
            ]

    def predict(self, variation: Mapping[str, float]) -> Prediction:
        """Returns the parameters with the best confidence bound of the first objective: the predicted mean, worse by a
        standard deviation. If no candidate satisfies the constraints by that bound, those that violate them least.

        :param variation: a value for each feature.
        :raises WrongValue: a feature is missing, unknown or out of its range; the text names all problems.
        """
        self.scenario.check_variation(variation)
        context = self._units(variation)
        with threadpool_limits(1):
            best = self._best(context)
            mean, deviation = self._success.predict(self._inputs(context, best))
        return Prediction(self._space.values(best[0]), float(np.clip(mean[0], 0.0, 1.0)), float(deviation[0]))

    def _best(self, context: Array) -> Array:
        """Returns the candidate with the best bound, shape (1, d): known ones, random ones, and near good ones."""
        random = np.random.default_rng(self.scenario.seed)
        good = self._points[np.argsort(-self._values)[:_CENTRES]]
        candidates = np.vstack([self._points, self._space.uniform(_UNIFORM, random)])
        for spread in _SPREADS:
            candidates = np.vstack([candidates, self._space.near(good, _AROUND, spread, random)])
            good = candidates[np.argsort(-self._bound(context, candidates))[:_CENTRES]]
        best: Array = good[:1]
        return best

    def _bound(self, context: Array, points: Array) -> Array:
        inputs = self._inputs(context, points)
        mean, deviation = self._objective.predict(inputs)
        bound: Array = mean - deviation
        lowest = float(bound.min())
        for surrogate, scale in self._violations:
            mean, deviation = surrogate.predict(inputs)
            violated = np.maximum(mean + deviation, 0.0) / scale
            bound = np.where(violated > 0.0, np.minimum(bound, lowest) - violated, bound)
        return bound

    def _inputs(self, context: Array, points: Array) -> Array:
        return np.hstack([np.tile(context, (len(points), 1)), points])

    def _units(self, variation: Mapping[str, float]) -> Array:
        return np.array([each.unit_of(variation[each.name]) for each in self.scenario.variations])


def _distance(scenario: Scenario, one: Mapping[str, float], other: Mapping[str, float]) -> float:
    units = [each.unit_of(one[each.name]) - each.unit_of(other[each.name]) for each in scenario.variations]
    return float(np.linalg.norm(units))
