"""The order of the evaluations of a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.scenario import Scenario


def ranked(scenario: Scenario, numbers: Iterable[int], results: Mapping[int, Evaluation]) -> list[int]:
    """Sorts evaluations by success rate, then by the objectives in their order; the best one first."""
    return sorted(
        numbers, key=lambda number: (-results[number].success_rate, *objective_costs(scenario, results[number]))
    )


def pareto_optimal(scenario: Scenario, results: Mapping[int, Evaluation]) -> list[int]:
    """Returns the numbers of the feasible evaluations that no other one dominates. Truncated ones take part only if no
    other is feasible: their means are of fewer repetitions."""
    feasible = {number: result for number, result in results.items() if is_feasible(result)}
    whole = {number: result for number, result in feasible.items() if not result.is_truncated} or feasible
    costs = {number: objective_costs(scenario, result) for number, result in whole.items()}
    return [n for n, own in costs.items() if not any(_dominates(other, own) for other in costs.values())]


def is_feasible(result: Evaluation) -> bool:
    """Whether an evaluation has a result that satisfies all constraints."""
    return not result.error and all(violation <= 0.0 for violation in result.violations.values())


def objective_costs(scenario: Scenario, result: Evaluation) -> tuple[float, ...]:
    """Returns the objectives as costs: less is better."""
    signs = (1.0 if objective.sense == "minimise" else -1.0 for objective in scenario.objectives)
    return tuple(s * v for s, v in zip(signs, result.objectives.values(), strict=True))


def _dominates(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))
