"""The variables of a learning scenario: their types, ranges and priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

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
