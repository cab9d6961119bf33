"""Imports scenarios in the JSON layout of HyperMapper: variables with priors, objectives, budget."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import ConfigDict, ValidationError

from skiros2_common.core.errors import ConfigurationError
from skiros2_learning.core.sections import (
    Mistake,
    Name,
    Named,
    Natural,
    Number,
    Positive,
    Section,
    Some,
    Text,
    mistakes_of,
    numbers,
    read,
)
from skiros2_learning.core.variables import Kind

#: The standard deviation of HyperMapper's named priors on numbers, as a fraction of the range; see its documentation of
#: `gaussian`: the mean is the middle of the range.
_STD = 0.25


class _Section(Section):
    """A section with keys that are not imported."""

    __pydantic_config__ = ConfigDict(extra="ignore")


@dataclass(frozen=True)
class _Parameter(_Section):
    name: Name
    parameter_type: Kind
    values: tuple[Any, ...]
    prior: Any = "uniform"
    custom_gaussian_prior_mean: Number | None = None
    custom_gaussian_prior_std: Positive | None = None

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        values, prior = data.get("values"), data.get("prior", "uniform")
        is_numeric = data.get("parameter_type") not in ("ordinal", "categorical")
        if is_numeric and (len(limits := numbers(values)) != 2 or limits[0] >= limits[1]):
            yield ("values",), f"expected a lower and an upper bound, got {values!r}"
        if prior not in ("uniform", "gaussian") if is_numeric else prior != "uniform" and not isinstance(prior, list):
            known = "gaussian, uniform" if is_numeric else "uniform, a list of weights"
            yield ("prior",), f"unknown: {prior!r}; there are: {known}"

    def variable(self) -> dict[str, Any]:
        """Returns the variable as in a scenario."""
        key = "range" if self.parameter_type in ("real", "integer") else "values"
        found: dict[str, Any] = {"type": self.parameter_type, key: list(self.values)}
        if isinstance(self.prior, list):
            found["prior"] = {"weights": self.prior}
        elif self.prior == "gaussian":
            low, high = map(float, self.values)
            mean, std = self.custom_gaussian_prior_mean, self.custom_gaussian_prior_std or _STD * (high - low)
            found["prior"] = {"mean": (low + high) / 2 if mean is None else mean, "std": std}
        return found


@dataclass(frozen=True)
class _Design(_Section):
    number_of_samples: Natural = 10


@dataclass(frozen=True)
class _File(_Section):
    input_parameters: Annotated[Named[_Parameter], Some]
    optimization_objectives: tuple[Text, ...]
    application_name: Text = ""
    optimization_iterations: Natural = 100
    design_of_experiment: _Design = field(default_factory=_Design)


def import_hypermapper(file: Path) -> str:
    """Returns the text of a scenario with the variables, priors, objectives and budget of a HyperMapper scenario. Task,
    scene and rewards, which HyperMapper does not have, remain to be filled in.

    :raises ConfigurationError: the file cannot be read, or has mistakes; the text names all of them.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{file}: {error}") from None
    try:
        found = read(_File, data)
    except ValidationError as error:
        raise ConfigurationError(f"{file}: {'; '.join(text for _, text in mistakes_of(error))}") from None
    initial = found.design_of_experiment.number_of_samples
    scenario = {
        "scenario": found.application_name or file.stem,
        "version": 1,
        "scene": "SCENE.ttl",
        "libraries": [],
        "task": [{"skill": "SKILL", "parameters": {}}],
        "variables": {each.name: each.variable() for each in found.input_parameters},
        "objectives": {
            name: {"sense": "minimise", "rewards": [{"reward": "REWARD"}]} for name in found.optimization_objectives
        },
        "budget": {"evaluations": found.optimization_iterations + initial, "initial": initial},
    }
    text: str = yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True)
    return text
