"""The variables of a learning scenario: their types, ranges and priors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from skiros2_learning.core.sections import Section

Kind = Literal["real", "integer", "ordinal", "categorical"]
KINDS: tuple[Kind, ...] = ("real", "integer", "ordinal", "categorical")

#: A value of a variable.
Value = float | int | str | bool


@dataclass(frozen=True)
class Gaussian:
    """A prior: good values are near the mean.

    :param mean, std: in the unit of the variable.
    """

    mean: float
    std: float


@dataclass(frozen=True)
class Samples:
    """A prior of a real or an integer variable: good values are near those that were good before.

    :param values, std: centres and standard deviation of normal kernels, in the unit of the variable.
    """

    values: tuple[float, ...]
    std: float


@dataclass(frozen=True)
class Weights:
    """A prior of an ordinal or categorical variable: the probability of each value, which sum to 1."""

    values: tuple[float, ...]


Prior = Gaussian | Samples | Weights


@dataclass(frozen=True)
class Variable:
    """A parameter of a skill to be learned.

    :param name: SKILL.PARAMETER, or STEP.PARAMETER if the task has several steps of that skill.
    :param low, high: of a real or an integer; both are included.
    :param values: of an ordinal (numbers, ascending) or a categorical variable.
    :param prior: None for a uniform one.
    """

    name: str
    kind: Kind
    low: float = 0.0
    high: float = 0.0
    values: tuple[Value, ...] = ()
    unit: str = ""
    prior: Prior | None = None

    @property
    def range_text(self) -> str:
        """The allowed values for people: `-0.2 to 0.2 m`, `one of slow, fast`."""
        if self.values:
            return f"one of {', '.join(map(str, self.values))}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:g} to {self.high:g}{unit}"

    def problem(self, value: Any) -> str:
        """Describes why a value is not allowed; "" if it is."""
        if self.values:
            allowed = any(value == each and isinstance(value, bool) == isinstance(each, bool) for each in self.values)
        else:
            kinds = (int,) if self.kind == "integer" else (int, float)
            allowed = isinstance(value, kinds) and not isinstance(value, bool) and self.low <= value <= self.high
        return "" if allowed else f"{self.name}: expected {self.range_text}, got {value!r}"


def configuration_problems(variables: Sequence[Variable], configuration: dict[str, Any]) -> list[str]:
    """Describes all mistakes in a configuration: missing, unknown and disallowed values."""
    names = {variable.name for variable in variables}
    found = [f"{name}: not a variable of the scenario" for name in configuration if name not in names]
    for variable in variables:
        if variable.name not in configuration:
            found.append(f"{variable.name}: no value")
        elif problem := variable.problem(configuration[variable.name]):
            found.append(problem)
    return found


def read_variable(name: str, section: Section) -> Variable:
    """Reads a variable of a scenario."""
    kind: Kind = section.choice("type", KINDS, "real")  # type: ignore[assignment]
    unit = section.text("unit", "")
    low = high = 0.0
    values: tuple[Value, ...] = ()
    if kind in ("real", "integer"):
        low, high = section.numbers("range", 2)
        if low >= high and len(section.items("range")) == 2:
            section.problem("range", f"expected the lower bound first, got [{low:g}, {high:g}]")
            low, high = high, low
        if kind == "integer" and (low % 1 or high % 1):
            section.problem("range", f"expected integers, got [{low:g}, {high:g}]")
    else:
        values = tuple(section.items("values"))
        _check_values(section, kind, values)
    prior = _prior(section, kind, low, high, values)
    section.end()
    return Variable(name, kind, low, high, values, unit, prior)


def _check_values(section: Section, kind: str, values: Sequence[Any]) -> None:
    if len(values) < 2:
        section.problem("values", f"expected at least two, got {len(values)}")
    elif len(set(map(repr, values))) < len(values):
        section.problem("values", f"expected different values, got {list(values)!r}")
    elif not all(isinstance(value, str | int | float) for value in values):
        section.problem("values", f"expected texts, numbers or truth values, got {list(values)!r}")
    elif kind == "ordinal":
        numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(numbers) < len(values) or sorted(numbers) != numbers:
            section.problem("values", f"expected numbers in ascending order, got {list(values)!r}")


def _prior(section: Section, kind: str, low: float, high: float, values: Sequence[Any]) -> Prior | None:
    if "prior" not in section:
        return None
    part = section.section("prior")
    prior: Prior | None = None
    if "weights" in part:
        numbers = [w for w in part.items("weights") if isinstance(w, int | float) and 0 <= w < math.inf]
        if not values:
            part.problem("weights", f"only for ordinal and categorical variables; this one is {kind}")
        elif len(numbers) != len(values) or len(part.items("weights")) != len(values) or sum(numbers) <= 0:
            part.problem("weights", f"expected {len(values)} numbers of 0 or more, not all 0")
        else:
            prior = Weights(tuple(number / sum(numbers) for number in numbers))
    elif "samples" in part:
        std = part.number("std", above=0.0)
        samples = part.numbers("samples", len(part.items("samples")))
        outside = [value for value in samples if not low <= value <= high]
        if values:
            part.problem("samples", f"only for real and integer variables; this one is {kind}; give weights")
        elif not samples:
            part.problem("samples", "none; expected at least one")
        elif outside:
            part.problem("samples", f"expected {low:g} to {high:g}, the range of the variable, got {outside}")
        else:
            prior = Samples(tuple(samples), std)
    else:
        mean, std = part.number("mean"), part.number("std", above=0.0)
        lowest, highest = (min(values), max(values)) if kind == "ordinal" and values else (low, high)
        if kind == "categorical":
            part.problem("", "a categorical variable has no mean; give weights")
        elif not lowest <= mean <= highest:
            part.problem("mean", f"expected {lowest:g} to {highest:g}, the range of the variable, got {mean:g}")
        else:
            prior = Gaussian(mean, std)
    part.end()
    return prior
