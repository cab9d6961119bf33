"""Applies a result: stores it in the world model as parameter sets, which skills take when they start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_learning.core.elements import find_element
from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.platforms import Step
from skiros2_learning.core.policy_table import ValidatedPolicy
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.validation import Sample
from skiros2_learning.core.variables import Value
from skiros2_skill.core.engine.learned_parameters import (
    APPLIES_TO,
    FEATURE,
    HAS_PARAMETER,
    HIGHEST,
    LOWEST,
    PARAMETER_SET,
    SKILL_TYPE,
    VALUE,
)

_SCENE = "skiros:Scene-0"


def apply_result(
    wmi: WorldModelPort,
    scenario: Scenario,
    number: int,
    result: Evaluation,
    date: str,
    source: str = "",
    validated: Sample | None = None,
) -> list[Element]:
    """Adds a parameter set for each step of the task with variables. Returns the elements.

    The newest set of a skill type counts; the sets stay until they are removed.

    :param number: of the evaluation.
    :param date: ISO 8601.
    :param source: folder or database of the study.
    :param validated: its repetitions on new draws; None if it is not validated.
    :raises Refused: the evaluation has no result.
    :raises UnknownName: the world model's ontology has no parameter sets.
    """
    if result.error:
        raise Refused(f"evaluation {number} is broken and cannot be applied: {result.error}")
    if not wmi.knows(PARAMETER_SET):
        raise UnknownName(f"the ontology of the world model has no class {PARAMETER_SET}")
    means = {name: validated.objective(name).estimate if validated else v for name, v in result.objectives.items()}
    rate = result.success_rate if validated is None else validated.success.estimate
    provenance = {
        "skiros:Study": f"{source or scenario.name}#{number}", "skiros:Seed": result.seed, "skiros:Date": date,
        "skiros:SuccessRate": rate, "skiros:Reward": [f"{name}={value:.6g}" for name, value in means.items()],
        **_validation(validated),
    }  # fmt: skip
    rows = [result.configuration]
    return [
        _add(wmi, scenario, step, f"{scenario.name} {number}", rows, provenance) for step in _learned_steps(scenario)
    ]


def apply_policy(
    wmi: WorldModelPort, scenario: Scenario, policy: ValidatedPolicy, date: str, source: str = ""
) -> list[Element]:
    """Adds a policy as a parameter set for each step of the task with variables. Returns the elements. Arguments as of
    `apply_result`.

    :raises Refused: a feature is of an element that is no parameter of the step: a start could not read it.
    :raises UnknownName: the world model's ontology has no policies.
    """
    if not wmi.knows(FEATURE):
        raise UnknownName(f"the ontology of the world model has no class {FEATURE}")
    table, sample = policy.table, policy.validation.learned
    means = {each.name: sample.objective(each.name).estimate for each in scenario.objectives}
    provenance = {
        "skiros:Study": source or scenario.name, "skiros:Seed": sample.seed, "skiros:Date": date,
        "skiros:SuccessRate": sample.success.estimate,
        "skiros:Reward": [f"{name}={value:.6g}" for name, value in means.items()], **_validation(sample),
    }  # fmt: skip
    keys = {step.name: _feature_keys(scenario, step) for step in _learned_steps(scenario)}
    added = []
    for step in _learned_steps(scenario):
        each = _add(wmi, scenario, step, f"{scenario.name}, {table.name}", table.configurations, provenance)
        for feature, key in zip(scenario.variations, keys[step.name], strict=True):
            part = Element(FEATURE, f"{key}.{feature.property}")
            part.setProperty(LOWEST, feature.range[0])
            part.setProperty(HIGHEST, feature.range[1])
            _add_part(wmi, each, part, [row[feature.name] for row in table.variations])
        added.append(wmi.get_element(each.id))
    return added


def _learned_steps(scenario: Scenario) -> list[Step]:
    names = {each.name.rpartition(".")[0] for each in scenario.variables}
    return [step for step in scenario.task if step.name in names]


def _feature_keys(scenario: Scenario, step: Step) -> list[str]:
    """Returns the parameters of a step with the elements of the features."""
    keys = {str(label): key for key, label in step.parameters.items()}
    for feature in scenario.variations:
        if feature.element not in keys:
            text = f"feature {feature.name} is of {feature.element!r}, which is no parameter of {step.name}"
            raise Refused(f"{text}: a start cannot read it")
    return [keys[feature.element] for feature in scenario.variations]


def _validation(sample: Sample | None) -> dict[str, Any]:
    if sample is None:
        return {"skiros:Validated": False}
    interval = sample.success
    return {
        "skiros:Validated": True, "skiros:Successes": sample.good, "skiros:Executions": sample.count,
        "skiros:LowestSuccessRate": interval.low, "skiros:HighestSuccessRate": interval.high,
    }  # fmt: skip


def _add(
    wmi: WorldModelPort,
    scenario: Scenario,
    step: Step,
    title: str,
    rows: Sequence[Mapping[str, Value]],
    provenance: Mapping[str, Any],
) -> Element:
    """Adds the parameter set of a step, with the values of all rows. Returns the element."""
    each = Element(PARAMETER_SET, f"{title}: {step.name}")
    each.setProperty(SKILL_TYPE, full_name(step.skill))
    classes = {key: _class_of(wmi, str(label)) for key, label in step.parameters.items()}
    if kinds := [f"{key}={found}" for key, found in classes.items() if found]:
        each.setProperty(APPLIES_TO, kinds)
    for key, value in provenance.items():
        each.setProperty(key, value)
    each.addRelation(_SCENE, "skiros:contain", "-1")
    wmi.add_element(each)
    for variable in scenario.variables:
        name, _, key = variable.name.rpartition(".")
        values = [row[variable.name] for row in rows if variable.name in row]
        if name == step.name and values:
            _add_part(wmi, each, Element("skiros:Parameter", key), values)
    return wmi.get_element(each.id)


def _add_part(wmi: WorldModelPort, whole: Element, part: Element, values: Sequence[Value]) -> None:
    part.setProperty(VALUE, list(values))
    part.addRelation(whole.id, HAS_PARAMETER, "-1")
    wmi.add_element(part)


def remove_set(wmi: WorldModelPort, eid: str) -> None:
    """Removes a parameter set with its values.

    :raises UnknownName: there is no such set.
    """
    found = wmi.find_element(eid)
    if found is None or found.type != PARAMETER_SET:
        known = ", ".join(each.id for each in wmi.resolve_elements(Element(PARAMETER_SET))) or "none"
        raise UnknownName(f"there is no parameter set {eid!r}; there are: {known}")
    for relation in found.getRelations("-1", HAS_PARAMETER):
        wmi.remove_element(wmi.get_element(relation["dst"]))
    wmi.remove_element(wmi.get_element(eid))


def _class_of(wmi: WorldModelPort, name: str) -> str:
    try:
        return str(find_element(wmi, name).type)
    except SkirosError:  # no element: a fixed value
        return ""
