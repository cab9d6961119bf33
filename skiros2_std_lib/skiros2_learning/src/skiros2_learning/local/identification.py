"""Identifies what can be learned: required parameters of a skill without a value become variables of a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_learning.core.sections import near
from skiros2_learning.core.variables import KINDS
from skiros2_skill.core.runtime.learned_parameters import HAS_PARAMETER
from skiros2_skill.testing import SkillBench

DATA_TYPE, PRIOR, MEAN, STD = "skiros:ParamDataType", "skiros:Prior", "skiros:Mean", "skiros:Std"
_LOW, _HIGH, _VALUES, _UNIT = "skiros:LowerBound", "skiros:UpperBound", "skiros:hasValues", "skiros:Unit"


def identify(scene: Path, libraries: Sequence[str], skill: str, parameters: Sequence[str]) -> str:
    """Returns the text of a scenario for a skill.

    :param scene: scene file.
    :param libraries: Python packages with the skill.
    :param parameters: texts KEY=VALUE with elements (by label) and fixed values.
    :raises UnknownName: the skill or a parameter does not exist.
    :raises Refused: nothing is to be learned, or a missing parameter has no limits.
    """
    bench = SkillBench(scene)
    bench.import_libraries(*libraries)
    declared = dict(bench.library.candidates(skill, "")[0].declared.params.items())
    given: dict[str, Any] = {}
    for text in parameters:
        key, equals, value = text.partition("=")
        if not equals:
            raise WrongValue(f"{text!r}: expected KEY=VALUE")
        if key not in declared:
            raise UnknownName(f"{skill} has no parameter {key!r}; {near(key, declared)}")
        given[key] = value if declared[key].is_element else yaml.safe_load(value)
    variables, problems = {}, []
    for key, param in declared.items():
        if key in given or not is_missing(param):
            continue
        try:
            variables[f"{skill}.{key}"] = variable_of(param, _individual(bench.wmi, skill, key))
        except WrongValue as error:
            problems.append(str(error))
    if problems:
        raise Refused(f"{skill}: {'; '.join(problems)}")
    if not variables:
        raise Refused(f"{skill} has no required parameter without a value: nothing is to be learned")
    scenario = {
        "scenario": skill.lower(),
        "version": 1,
        "scene": str(scene),
        "libraries": list(libraries),
        "task": [{"skill": skill, "parameters": given}],
        "variables": variables,
        "objectives": {"success": {"sense": "maximise", "rewards": [{"reward": "success"}]}},
        "budget": {"evaluations": 100, "initial": 20},
        "repetitions": 5,
        "seed": 1,
        "optimiser": "prior",
    }
    return yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True, width=110)


def is_missing(param: Param) -> bool:
    """Whether a start of the skill needs a value that is neither an element nor declared."""
    return param.paramTypeIs(ParamTypes.Required) and not param.is_element and not param.is_bound()


def variable_of(param: Param, individual: Element | None = None) -> dict[str, Any]:
    """Returns a variable as in a scenario, from the declaration of a parameter and its individual in the world model.
    The individual takes precedence.

    :raises WrongValue: the limits are not known.
    """
    limits = param.limits
    low, high = _number(individual, _LOW, limits.minimum), _number(individual, _HIGH, limits.maximum)
    choices = list(limits.choices)
    if individual is not None and individual.hasProperty(_VALUES):
        choices = list(individual.getProperty(_VALUES).values)
    stated = individual.value_of(DATA_TYPE) if individual is not None else None
    if stated is not None and stated not in KINDS:
        raise WrongValue(f"{param.key}: {DATA_TYPE} is {stated!r}; {near(str(stated), KINDS)}")
    found: dict[str, Any] = {}
    if choices or param.dataType() is bool:
        values = choices or [False, True]
        numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
        kind = "ordinal" if numbers else "categorical"
        found = {"type": stated or kind, "values": sorted(values) if numbers else values}
    elif low is not None and high is not None:
        found = {"type": stated or ("integer" if param.dataType() is int else "real"), "range": [low, high]}
    else:
        raise WrongValue(f"parameter {param.key!r} has no minimum and maximum and no choices: it cannot be learned")
    unit = (individual.value_of(_UNIT) if individual is not None else None) or limits.unit
    if unit:
        found["unit"] = str(unit)
    if individual is not None and individual.hasProperty(MEAN) and individual.hasProperty(STD):
        found["prior"] = {"mean": float(individual.value_of(MEAN)), "std": float(individual.value_of(STD))}
    elif individual is not None and individual.hasProperty(PRIOR) and "values" in found:
        found["prior"] = {"weights": [float(weight) for weight in individual.getProperty(PRIOR).values]}
    return found


def _individual(wmi: WorldModelPort, skill: str, key: str) -> Element | None:
    """Returns the individual of a parameter: a `skiros:Parameter` with the key as label, of an element of the skill's
    type, or on its own with the label SKILL.KEY."""
    for element in wmi.resolve_elements(Element("skiros:Parameter", key)):
        for relation in element.getRelations("", HAS_PARAMETER, "-1"):
            if wmi.get_element(relation["src"]).type.rpartition(":")[2] == skill:
                return element
    alone = wmi.resolve_elements(Element("skiros:Parameter", f"{skill}.{key}"))
    return alone[0] if alone else None


def _number(individual: Element | None, key: str, default: float | None) -> float | None:
    value = individual.value_of(key) if individual is not None else None
    return default if value is None else float(value)
