"""Identifies what can be learned: required parameters of a skill without a value become variables of a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from skiros2_common.core.errors import Refused, UnknownName, WrongValue
from skiros2_common.core.names import local_name
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_common.core.yaml_text import read_yaml
from skiros2_learning.core.scenario import Step
from skiros2_learning.core.sections import near
from skiros2_learning.core.variables import KINDS
from skiros2_learning.local.episode import is_missing
from skiros2_skill.core.engine.learned_parameters import HAS_PARAMETER
from skiros2_skill.testing import SkillBench
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.testing import plan

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
    declared = _declared(bench, skill)
    given: dict[str, Any] = {}
    for text in parameters:
        key, equals, value = text.partition("=")
        if not equals:
            raise WrongValue(f"{text!r}: expected KEY=VALUE")
        if key not in declared:
            raise UnknownName(f"{skill} has no parameter {key!r}; {near(key, declared)}")
        given[key] = value if declared[key].is_element else read_yaml(value)
    return _scenario(bench, scene, libraries, [Step(skill, skill, "", given)], skill.lower())


def identify_goal(scene: Path, libraries: Sequence[str], goal: str) -> str:
    """Returns the text of a scenario for a goal: its task is the plan of the scene's robot.

    :param goal: as for the task manager; see `identify` for the others.
    :raises Refused: there is no plan, or see `identify`. The text is one line.
    :raises SkirosError: the goal cannot be read.
    """
    bench = SkillBench(scene)
    bench.import_libraries(*libraries)
    labels = {each.id: each.label for each in bench.wmi.get_scene_elements()}
    names = list(labels.values())
    described = [each.skill for each in bench.library.descriptions.all()]
    skills = [each.label for each in described if each.hasPreCond() and each.hasPostCond()]
    try:
        calls = plan(bench, goal, skills, assume=True)
    except Refused as error:
        lines = [line.strip().rstrip(".") for line in str(error).splitlines()]
        raise Refused(f"goal {goal!r}: {'; '.join(lines[:2])}") from None
    if not calls:
        raise Refused(f"goal {goal!r} holds already: nothing is to be learned")
    steps: list[Step] = []
    for call in calls:
        skill = local_name(call.type)
        created = [key for key, element in call.arguments if element.id not in labels]
        if created:
            keys = ", ".join(created)
            raise Refused(f"goal {goal!r}: {keys} of {skill} would be created by an earlier step of the plan")
        count = sum(each.skill == skill for each in steps) + 1
        declared = _declared(bench, skill, call.label)
        given = {
            key: element.label if names.count(element.label) == 1 else element.id
            for key, element in call.arguments
            if key != ROBOT_KEY and not _follows(declared[key], bench)
        }
        steps.append(Step(skill if count == 1 else f"{skill}{count}", skill, call.label, given))
    return _scenario(bench, scene, libraries, steps, steps[-1].skill.lower(), goal)


def _scenario(
    bench: SkillBench, scene: Path, libraries: Sequence[str], steps: Sequence[Step], name: str, goal: str = ""
) -> str:
    """Returns the text of a scenario whose variables are the missing parameters of the steps."""
    variables, problems = {}, []
    for step in steps:
        for key, param in _declared(bench, step.skill, step.label).items():
            if key in step.parameters or not is_missing(param):
                continue
            try:
                variables[f"{step.name}.{key}"] = variable_of(param, _individual(bench.wmi, step.skill, key))
            except WrongValue as error:
                problems.append(f"{step.skill}: {error}")
    if problems:
        raise Refused("; ".join(problems))
    if not variables:
        skills = " and ".join(dict.fromkeys(step.skill for step in steps))
        raise Refused(f"{skills}: no required parameter is without a value: nothing is to be learned")
    tasks: list[dict[str, Any]] = []
    for step in steps:
        named = {"name": step.name} if step.name != step.skill else {}
        label = {"label": step.label} if step.label else {}
        tasks.append({"skill": step.skill, **named, **label, "parameters": dict(step.parameters)})
    scenario = {
        "scenario": name,
        "version": 1,
        **({"goal": goal} if goal else {}),
        "scene": str(scene),
        "libraries": list(libraries),
        "task": tasks,
        "variables": variables,
        "objectives": {"success": {"sense": "maximise", "rewards": [{"reward": "success"}]}},
        "budget": {"evaluations": 100, "initial": 20},
        "repetitions": 5,
        "seed": 1,
        "optimiser": "prior",
    }
    return yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True, width=110)


def _follows(param: Param, bench: SkillBench) -> bool:
    """Whether a parameter need not be stated: it is inferred, and there is only one element for it."""
    return param.paramTypeIs(ParamTypes.Inferred) and len(bench.wmi.resolve_elements(Element(param.value.type))) == 1


def _declared(bench: SkillBench, skill: str, label: str = "") -> dict[str, Param]:
    return dict(bench.library.candidates(skill, label)[0].declared.params.items())


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
