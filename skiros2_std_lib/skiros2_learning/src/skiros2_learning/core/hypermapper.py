"""Imports scenarios in the JSON layout of HyperMapper: variables with priors, objectives, budget."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from skiros2_common.core.errors import ConfigurationError
from skiros2_learning.core.sections import Section

#: The standard deviation of HyperMapper's named priors on numbers, as a fraction of the range; see its documentation of
#: `gaussian`: the mean is the middle of the range.
_STD = 0.25


def import_hypermapper(file: Path) -> str:
    """Returns the text of a scenario with the variables, priors, objectives and budget of a HyperMapper scenario. Task,
    scene and rewards, which HyperMapper does not have, remain to be filled in.

    :raises ConfigurationError: the file cannot be read, or has mistakes; the text names all of them.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{file}: {error}") from None
    problems: list[str] = []
    root = Section(data, "", problems)
    variables = {name: _variable(part) for name, part in root.section("input_parameters").sections()}
    if not variables:
        root.problem("input_parameters", "none")
    objectives = root.texts("optimization_objectives")
    iterations = root.whole("optimization_iterations", 100, low=0)
    doe = root.section("design_of_experiment")
    initial = doe.whole("number_of_samples", 10, low=0)
    if problems:
        raise ConfigurationError(f"{file}: {'; '.join(problems)}")
    scenario = {
        "scenario": root.text("application_name", file.stem),
        "version": 1,
        "scene": "SCENE.ttl",
        "libraries": [],
        "task": [{"skill": "SKILL", "parameters": {}}],
        "variables": variables,
        "objectives": {name: {"sense": "minimise", "rewards": [{"reward": "REWARD"}]} for name in objectives},
        "budget": {"evaluations": iterations + initial, "initial": initial},
    }
    text: str = yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True)
    return text


def _variable(section: Section) -> dict[str, Any]:
    kind = section.choice("parameter_type", ("real", "integer", "ordinal", "categorical"))
    values = section.items("values")
    found: dict[str, Any] = {"type": kind}
    if kind in ("real", "integer"):
        numeric = len(values) == 2 and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        if not numeric or values[0] >= values[1]:
            section.problem("values", f"expected a lower and an upper bound, got {values!r}")
            values = [0, 1]
        found["range"] = values
    else:
        found["values"] = values
    prior = section.take("prior", "uniform")
    if isinstance(prior, list):
        if kind in ("real", "integer"):
            section.problem("prior", "weights are for ordinal and categorical parameters")
        found["prior"] = {"weights": prior}
    elif prior == "gaussian" and kind in ("real", "integer"):
        found["prior"] = _gaussian(section, values)
    elif prior != "uniform":
        section.problem("prior", f"unknown: {prior!r}; there are: gaussian, uniform, a list of weights")
    return found


def _gaussian(section: Section, values: Sequence[float]) -> dict[str, float]:
    low, high = float(values[0]), float(values[1])
    mean = section.number("custom_gaussian_prior_mean", (low + high) / 2, low=low, high=high)
    return {"mean": mean, "std": section.number("custom_gaussian_prior_std", _STD * (high - low), above=0.0)}
