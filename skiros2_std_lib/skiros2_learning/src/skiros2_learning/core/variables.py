"""The variables of a learning scenario: their types, ranges and priors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator

from skiros2_learning.core.sections import (
    Keyed,
    Mistake,
    Name,
    Number,
    Positive,
    Range,
    Section,
    Some,
    Text,
    mistaken,
    near,
    numbers,
    read,
)

Kind = Literal["real", "integer", "ordinal", "categorical"]
KINDS: tuple[Kind, ...] = get_args(Kind)

#: A value of a variable.
Value = float | int | str | bool


@dataclass(frozen=True)
class Gaussian(Section):
    """A prior: good values are near the mean.

    :param mean, std: in the unit of the variable.
    """

    mean: Number
    std: Positive


@dataclass(frozen=True)
class Samples(Section):
    """A prior of a real or an integer variable: good values are near those that were good before.

    :param values, std: centres and standard deviation of normal kernels, in the unit of the variable.
    """

    values: Annotated[tuple[Number, ...], Field(alias="samples")]
    std: Positive


def _normalised(weights: tuple[float, ...]) -> tuple[float, ...]:
    total = sum(weights) or 1.0
    return tuple(weight / total for weight in weights)


@dataclass(frozen=True)
class Weights(Section):
    """A prior of an ordinal or categorical variable: the probability of each value, which sum to 1."""

    values: Annotated[tuple[Number, ...], Field(alias="weights"), AfterValidator(_normalised)]


Prior = Gaussian | Samples | Weights
#: The keys of the priors of a kind of variable.
_PRIORS = {
    "real": ("mean", "samples"),
    "integer": ("mean", "samples"),
    "ordinal": ("mean", "weights"),
    "categorical": ("weights",),
}


def _read_prior(data: Any) -> Prior:
    keys = data if isinstance(data, Mapping) else ()
    kind: type[Prior] = Weights if "weights" in keys else Samples if "samples" in keys else Gaussian
    return read(kind, data)


def _as_list(data: Any) -> Any:
    return data if isinstance(data, list) else [data]


@dataclass(frozen=True)
class Variable(Section):
    """A parameter of a skill to be learned.

    :param name: SKILL.PARAMETER, or STEP.PARAMETER if the task has several steps of that skill.
    :param range: lowest and highest value of a real or an integer.
    :param values: of an ordinal (numbers, ascending) or a categorical variable.
    :param scale: of a real or an integer: on a logarithmic one, samplers see 0.1 to 1 as wide as 1 to 10.
    :param prior: None for a uniform one.
    :param only_if: variables above with their values, all of which this one needs: it does not exist without them.
    """

    name: Name
    kind: Annotated[Kind, Field(alias="type")] = "real"
    range: Range = (0.0, 0.0)
    values: tuple[Any, ...] = ()
    unit: Text = ""
    scale: Literal["linear", "log"] = "linear"
    prior: Annotated[Prior | None, PlainValidator(_read_prior)] = None
    only_if: Keyed[Annotated[tuple[Any, ...], BeforeValidator(_as_list)]] = field(default_factory=dict)

    @property
    def condition_text(self) -> str:
        """When it exists, for people: `Push.Mode is fast or slow`; "" for always."""
        return " and ".join(f"{name} is {' or '.join(map(str, values))}" for name, values in self.only_if.items())

    @property
    def low(self) -> float:
        return self.range[0]

    @property
    def high(self) -> float:
        return self.range[1]

    @property
    def range_text(self) -> str:
        """The allowed values for people: `-0.2 to 0.2 m`, `one of slow, fast`."""
        if self.values:
            return f"one of {', '.join(map(str, self.values))}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:g} to {self.high:g}{unit}"

    def exists(self, configuration: Mapping[str, Any]) -> bool:
        """Whether it exists beside these values of the variables above."""
        return all(name in configuration and configuration[name] in values for name, values in self.only_if.items())

    @property
    def typical(self) -> Value:
        """An allowed value: the mean of the prior, the middle of the range, or the first one of several."""
        if self.values:
            first: Value = self.values[0]
            return first
        middle = math.sqrt(self.low * self.high) if self.scale == "log" else (self.low + self.high) / 2.0
        if isinstance(self.prior, Gaussian):
            middle = self.prior.mean
        return round(middle) if self.kind == "integer" else middle

    def problem(self, value: Any) -> str:
        """Describes why a value is not allowed; "" if it is."""
        if self.values:
            allowed = any(value == each and isinstance(value, bool) == isinstance(each, bool) for each in self.values)
        else:
            kinds = (int,) if self.kind == "integer" else (int, float)
            allowed = isinstance(value, kinds) and not isinstance(value, bool) and self.low <= value <= self.high
        return "" if allowed else f"{self.name}: expected {self.range_text}, got {value!r}"

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        kind, values = data.get("type", "real"), data.get("values")
        if kind not in KINDS:
            return
        limits = numbers(data.get("range"))
        given, other = ("range", "values") if kind in ("real", "integer") else ("values", "range")
        if given not in data:
            yield (given,), "missing"
        if other in data:
            yield (other,), f"not for variables of type {kind}; give {given}"
        elif data.get("scale") == "log" and (given != "range" or (limits and min(limits) <= 0.0)):
            yield ("scale",), "expected log only for a range above 0"
        elif kind == "integer" and len(limits) == 2 and any(limit % 1 for limit in limits):
            yield ("range",), f"expected integers, got [{limits[0]:g}, {limits[1]:g}]"
        elif isinstance(values, list) and (text := _values_mistake(kind, values)):
            yield ("values",), text
        prior = data["prior"] if isinstance(data.get("prior"), Mapping) else {}
        ends = numbers(values) or (limits if len(limits) == 2 else [])
        for key in [each for each in ("mean", "samples", "weights") if each in prior]:
            if key not in _PRIORS[kind]:
                yield ("prior", key), f"not for variables of type {kind}; give {' or '.join(_PRIORS[kind])}"
            elif text := _prior_mistake(prior[key], key, ends, values if isinstance(values, list) else ()):
                yield ("prior", key), text


@dataclass(frozen=True)
class Restriction(Section):
    """A constraint between variables: a weighted sum of real, integer or ordinal ones has limits.

    :param weights: by name of the variable.
    """

    weights: Annotated[Keyed[Number], Field(alias="sum"), Some]
    at_least: Number = -math.inf
    at_most: Number = math.inf

    def holds(self, configuration: Mapping[str, Value]) -> bool:
        """Whether a configuration satisfies it."""
        total = sum(weight * float(configuration[name]) for name, weight in self.weights.items())
        return self.at_least <= total <= self.at_most

    def can_hold(self, ends: Mapping[str, Sequence[float]]) -> bool:
        """Whether some values satisfy it.

        :param ends: by name, the bounds or all values of each variable.
        """
        terms = [[weight * value for value in ends[name]] for name, weight in self.weights.items()]
        return sum(map(min, terms)) <= self.at_most and sum(map(max, terms)) >= self.at_least

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        if not data.keys() & {"at_least", "at_most"}:
            yield (), "expected at_least or at_most"


def configuration_problems(variables: Sequence[Variable], configuration: dict[str, Any]) -> list[str]:
    """Describes all mistakes in a configuration: missing, unknown and disallowed values."""
    names = {variable.name for variable in variables}
    found = [f"{name}: not a variable of the scenario" for name in configuration if name not in names]
    for variable in variables:
        if not variable.exists(configuration):
            if variable.name in configuration:
                found.append(f"{variable.name}: only if {variable.condition_text}")
        elif variable.name not in configuration:
            found.append(f"{variable.name}: no value")
        elif problem := variable.problem(configuration[variable.name]):
            found.append(problem)
    return found


def existing(variables: Sequence[Variable], configuration: Mapping[str, Value]) -> dict[str, Value]:
    """Returns the part of a configuration whose variables exist."""
    found: dict[str, Value] = {}
    for variable in variables:
        if variable.exists(found):
            found[variable.name] = configuration[variable.name]
    return found


def check_conditions(variables: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """Checks that variables depend on allowed values of variables above them. Returns them.

    :raises ValidationError: with all mistakes.
    """
    wrong: list[Mistake] = []
    for index, variable in enumerate(variables):
        above = {each.name: each for each in variables[:index] if each.values}
        for name, values in variable.only_if.items():
            if name not in above:
                text = f"expected a variable above this one that has values; {near(name, list(above))}"
                wrong.append(((variable.name, "only_if", name), text))
            elif problem := next(filter(None, map(above[name].problem, values)), ""):
                wrong.append(((variable.name, "only_if", name), problem))
    if wrong:
        raise mistaken(wrong)
    return variables


def _values_mistake(kind: str, values: Sequence[Any]) -> str:
    if len(values) < 2:
        return f"expected at least two, got {len(values)}"
    if len(set(map(repr, values))) < len(values):
        return f"expected different values, got {values!r}"
    if not all(isinstance(value, str | int | float) for value in values):
        return f"expected texts, numbers or truth values, got {values!r}"
    if kind == "ordinal" and (len(numbers(values)) < len(values) or sorted(values) != values):
        return f"expected numbers in ascending order, got {values!r}"
    return ""


def _prior_mistake(found: Any, key: str, ends: Sequence[float], values: Sequence[Any]) -> str:
    if key == "weights":
        fit = isinstance(found, list) and len(found) == len(values) and min(numbers(found), default=-1.0) >= 0.0
        return "" if fit and any(found) else f"expected {len(values)} numbers of 0 or more, not all 0"
    if found == []:
        return "none; expected at least one"
    outside = [value for value in numbers(found) if ends and not min(ends) <= value <= max(ends)]
    got = outside if isinstance(found, list) else f"{sum(outside):g}"
    return f"expected {min(ends):g} to {max(ends):g}, the range of the variable, got {got}" if outside else ""
