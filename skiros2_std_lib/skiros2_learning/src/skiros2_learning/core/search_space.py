"""The search space of the prior sampler: priors of its variables, and values as points of numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from scipy.stats.qmc import LatinHypercube

Array = npt.NDArray[np.float64]

#: Smallest density, relative to the largest one: no value is impossible.
_LEAST_DENSITY = 1e-12


class Prior(Protocol):
    """A belief about good values of one variable."""

    def log_density(self, value: Any) -> float:
        """Returns the logarithm of the density of a value, up to a constant."""
        ...


@dataclass(frozen=True)
class Normal:
    """A normal prior, truncated to the range of the variable."""

    mean: float
    std: float

    def log_density(self, value: Any) -> float:
        return -0.5 * ((float(value) - self.mean) / self.std) ** 2


@dataclass(frozen=True)
class Kernels:
    """A prior as a kernel density: a mean of normal distributions, truncated to the range of the variable."""

    centres: tuple[float, ...]
    std: float

    def log_density(self, value: Any) -> float:
        logs = -0.5 * ((float(value) - np.array(self.centres)) / self.std) ** 2
        return float(np.logaddexp.reduce(logs)) - math.log(len(self.centres))


@dataclass(frozen=True)
class Choice:
    """A prior of a categorical or ordinal variable.

    :param weights: by value; 0 for a value that is not there.
    """

    weights: Mapping[Any, float]

    def log_density(self, value: Any) -> float:
        return math.log(max(self.weights.get(value, 0.0), _LEAST_DENSITY))


@dataclass(frozen=True)
class Condition:
    """A variable exists only if another one has one of some values.

    :param needed: the other one, which is categorical.
    """

    name: str
    needed: str
    values: tuple[Any, ...]


class HasParams(Protocol):
    """A trial, or anything else with a value for each variable."""

    @property
    def params(self) -> Mapping[str, Any]: ...


class SearchSpace:
    """A search space as points: one number per variable, from 0 to 1; of a nominal one, the index of its value.

    :param conditions: variables that exist only with values of others. Where one does not, points have the place where
        its prior is highest: all such points are alike in it.
    """

    def __init__(
        self,
        distributions: Mapping[str, BaseDistribution],
        priors: Mapping[str, Prior],
        conditions: Sequence[Condition] = (),
    ) -> None:
        self._distributions = dict(sorted(distributions.items()))
        self._priors = [priors.get(name) for name in self._distributions]
        self.nominal = [_is_nominal(distribution) for distribution in self._distributions.values()]
        #: For each number of a point, how many values without an order it has; 0 if it is a number from 0 to 1.
        self.choices = [_count(d) if _is_nominal(d) else 0 for d in self._distributions.values()]
        self.dimensions = len(self._distributions)
        self._tables: dict[int, tuple[Array, Array]] = {}
        names = list(self._distributions)
        self._conditions: list[tuple[int, int, Array]] = []
        for each in conditions:
            units = np.array([_to_unit(self._distributions[each.needed], value) for value in each.values])
            self._conditions.append((names.index(each.name), names.index(each.needed), units))
        self._absent = [
            self._highest(i) if any(each[0] == i for each in self._conditions) else 0.0 for i in range(self.dimensions)
        ]

    def points(self, trials: Sequence[HasParams]) -> Array:
        """Returns the points of trials, shape (n, d)."""
        items = list(zip(self._distributions.items(), self._absent, strict=True))
        return np.array(
            [
                [_to_unit(d, each.params[name]) if name in each.params else absent for (name, d), absent in items]
                for each in trials
            ]
        ).reshape(len(trials), self.dimensions)

    def values(self, point: Array) -> dict[str, Any]:
        """Returns the values of a point by name."""
        return {name: _from_unit(d, float(x)) for (name, d), x in zip(self._distributions.items(), point, strict=True)}

    def rounded(self, points: Array) -> Array:
        """Returns the points with values that exist: integers, choices, and variables beside the values of others."""
        found = np.column_stack(
            [_round_units(distribution, points[:, i]) for i, distribution in enumerate(self._distributions.values())]
        )
        missing = np.zeros(found.shape, dtype=bool)
        for i, needed, units in self._conditions:
            fits = (np.abs(found[:, needed, None] - units) < 1e-9).any(axis=1)
            missing[:, i] |= ~fits | missing[:, needed]
        return np.where(missing, self._absent, found)

    def _highest(self, index: int) -> float:
        grid, logs = self._table(index, list(self._distributions.values())[index], self._priors[index])
        return float(grid[int(np.argmax(logs))] if self._priors[index] is not None else grid[len(grid) // 2])

    def uniform(self, count: int, random: np.random.Generator) -> Array:
        """Draws points without the prior."""
        points = random.random((count, self.dimensions))
        for i, distribution in enumerate(self._distributions.values()):
            if self.nominal[i]:
                points[:, i] = random.integers(len(distribution.choices), size=count)  # type: ignore[attr-defined]
        return self.rounded(points)

    def from_prior(self, count: int, random: np.random.Generator) -> Array:
        """Draws points from the prior, each variable on its own, on a grid of values."""
        return self.quantiles(random.random((count, self.dimensions)))

    def covering(self, count: int, random: np.random.Generator) -> Array:
        """Draws points that cover the prior evenly: a Latin hypercube of its quantiles."""
        return self.quantiles(LatinHypercube(self.dimensions, seed=random).random(count))

    def quantiles(self, parts: Array) -> Array:
        """Returns the points at quantiles of the prior, each variable on its own.

        :param parts: 0 to 1, shape (n, d).
        """
        columns = []
        for i, distribution in enumerate(self._distributions.values()):
            grid, logs = self._table(i, distribution, self._priors[i])
            weights = np.exp(logs)
            ends = np.cumsum(weights / weights.sum())
            cell = np.minimum(np.searchsorted(ends, parts[:, i], side="right"), len(grid) - 1)
            drawn = grid[cell]
            if isinstance(distribution, FloatDistribution):  # between the points of the grid
                within = (parts[:, i] - ends[cell]) * weights.sum() / weights[cell] + 0.5
                drawn = np.clip(drawn + within * (grid[1] - grid[0]), 0.0, 1.0)
            columns.append(drawn)
        return self.rounded(np.column_stack(columns))

    def _table(self, index: int, distribution: BaseDistribution, prior: Prior | None) -> tuple[Array, Array]:
        """Returns points of one variable that cover its range, and the logarithms of the density, 0 at its maximum."""
        if index not in self._tables:
            grid = _grid(distribution)
            values = [_from_unit(distribution, float(x)) for x in grid] if prior is not None else []
            logs = np.array([prior.log_density(x) for x in values]) if prior is not None else np.zeros(len(grid))
            self._tables[index] = grid, logs - logs.max()
        return self._tables[index]

    def near(self, points: Array, count: int, spread: float, random: np.random.Generator) -> Array:
        """Draws points around given ones, `count` each."""
        centres = np.repeat(points, count, axis=0)
        moved = centres + random.normal(0.0, spread, centres.shape) * (random.random(centres.shape) < 0.7)
        for i, distribution in enumerate(self._distributions.values()):
            if self.nominal[i]:
                other = random.integers(len(distribution.choices), size=len(centres))  # type: ignore[attr-defined]
                keeps = random.random(len(centres)) > 1.0 / self.dimensions
                moved[:, i] = np.where(keeps, centres[:, i], other)
            else:
                moved[:, i] = np.clip(moved[:, i], 0.0, 1.0)
        return self.rounded(moved)

    def log_prior(self, points: Array) -> Array:
        """Returns the logarithm of the prior's density, 0 at its maximum; bounded below."""
        total = np.zeros(len(points))
        for i, distribution in enumerate(self._distributions.values()):
            prior = self._priors[i]
            if prior is None:
                continue
            grid, logs = self._table(i, distribution, prior)
            nearest = np.abs(points[:, i, None] - grid).argmin(axis=1) if _count(distribution) else None
            found = logs[nearest] if nearest is not None else np.interp(points[:, i], grid, logs)
            total += np.maximum(found, math.log(_LEAST_DENSITY))
        return total


def _is_nominal(distribution: BaseDistribution) -> bool:
    """Whether the values have no order."""
    return isinstance(distribution, CategoricalDistribution) and not all(
        isinstance(choice, int | float) and not isinstance(choice, bool) for choice in distribution.choices
    )


def _order(distribution: CategoricalDistribution) -> list[Any]:
    """Returns the choices; those of an ordinal variable in ascending order."""
    choices = list(distribution.choices)
    return choices if _is_nominal(distribution) else sorted(choices)


def _count(distribution: BaseDistribution) -> int:
    """Returns the number of values; 0 for infinitely many."""
    if isinstance(distribution, CategoricalDistribution):
        return len(distribution.choices)
    if isinstance(distribution, IntDistribution | FloatDistribution) and distribution.step:
        return round((distribution.high - distribution.low) / distribution.step) + 1
    return 0


def _grid(distribution: BaseDistribution) -> Array:
    """Returns points of one variable that cover its range."""
    count = _count(distribution)
    if _is_nominal(distribution):
        return np.arange(count, dtype=float)
    return np.linspace(0.0, 1.0, count if 0 < count <= 1000 else 501)


def _round_units(distribution: BaseDistribution, units: Array) -> Array:
    if _is_nominal(distribution):
        return units
    count = _count(distribution)
    if count > 1 and not getattr(distribution, "log", False):
        rounded: Array = np.round(units * (count - 1)) / (count - 1)
        return rounded
    return units


def _to_unit(distribution: BaseDistribution, value: Any) -> float:
    if isinstance(distribution, CategoricalDistribution):
        index = _order(distribution).index(value)
        return float(index) if _is_nominal(distribution) else index / max(1, len(distribution.choices) - 1)
    assert isinstance(distribution, FloatDistribution | IntDistribution)
    low, high = float(distribution.low), float(distribution.high)
    if distribution.log:
        return math.log(value / low) / math.log(high / low)
    return (float(value) - low) / (high - low)


def _from_unit(distribution: BaseDistribution, unit: float) -> Any:
    if isinstance(distribution, CategoricalDistribution):
        choices = _order(distribution)
        return choices[round(unit if _is_nominal(distribution) else unit * (len(choices) - 1))]
    assert isinstance(distribution, FloatDistribution | IntDistribution)
    low, high = float(distribution.low), float(distribution.high)
    value = low * (high / low) ** unit if distribution.log else low + unit * (high - low)
    if distribution.step:
        value = low + round((value - low) / distribution.step) * distribution.step
    value = min(max(value, low), high)
    return round(value) if isinstance(distribution, IntDistribution) else value
