"""Applies a result: stores it in the world model as parameter sets, which skills take when they start."""

from __future__ import annotations

from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_learning.core.elements import find_element
from skiros2_learning.core.evaluation import Evaluation
from skiros2_learning.core.scenario import Scenario
from skiros2_learning.core.validation import Sample
from skiros2_skill.core.engine.learned_parameters import (
    APPLIES_TO,
    HAS_PARAMETER,
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
    added = []
    for step in scenario.task:
        values = {
            name.rpartition(".")[2]: value
            for name, value in result.configuration.items()
            if name.rpartition(".")[0] == step.name
        }
        if not values:
            continue
        each = Element(PARAMETER_SET, f"{scenario.name} {number}: {step.name}")
        each.setProperty(SKILL_TYPE, full_name(step.skill))
        classes = {key: _class_of(wmi, str(label)) for key, label in step.parameters.items()}
        kinds = [f"{key}={found}" for key, found in classes.items() if found]
        if kinds:
            each.setProperty(APPLIES_TO, kinds)
        each.setProperty("skiros:Study", f"{source or scenario.name}#{number}")
        each.setProperty("skiros:Seed", result.seed)
        each.setProperty("skiros:Date", date)
        each.setProperty("skiros:Validated", validated is not None)
        if validated is not None:
            interval = validated.success
            each.setProperty("skiros:Successes", validated.good)
            each.setProperty("skiros:Executions", validated.count)
            each.setProperty("skiros:LowestSuccessRate", interval.low)
            each.setProperty("skiros:HighestSuccessRate", interval.high)
        each.setProperty("skiros:SuccessRate", result.success_rate if validated is None else validated.success.estimate)
        means = {name: validated.objective(name).estimate if validated else v for name, v in result.objectives.items()}
        each.setProperty("skiros:Reward", [f"{name}={value:.6g}" for name, value in means.items()])
        each.addRelation(_SCENE, "skiros:contain", "-1")
        wmi.add_element(each)
        for key, value in values.items():
            part = Element("skiros:Parameter", key)
            part.setProperty(VALUE, value)
            part.addRelation(each.id, HAS_PARAMETER, "-1")
            wmi.add_element(part)
        added.append(wmi.get_element(each.id))
    return added


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
