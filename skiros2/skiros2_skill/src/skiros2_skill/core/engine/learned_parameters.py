"""Parameter sets: values of a skill's parameters that were learned, as elements of the world model.

A set is an element of class `skiros:ParameterSet` with `skiros:SkillType`. Its parts (`skiros:hasParam`) are values:
`skiros:Parameter` with the key as label and `skiros:Value`. Its `skiros:AppliesTo` restrict it to a kind of task:
texts KEY=CLASS, the class of the element in a parameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skiros2_common.core.names import full_name, is_of_class
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort

PARAMETER_SET = "skiros:ParameterSet"
SKILL_TYPE, APPLIES_TO, VALUE = "skiros:SkillType", "skiros:AppliesTo", "skiros:Value"
HAS_PARAMETER = "skiros:hasParam"


def learned_values(stype: str, given: Mapping[str, Sequence[Any]], wmi: WorldModelPort) -> dict[str, list[Any]]:
    """Returns the learned values for a start of a skill, by key; {} without a set. The newest set counts: that with the
    highest number.

    :param stype: the type of the skill.
    :param given: the values of the request, by key.
    """
    for each in sorted(_sets(stype, wmi), key=lambda s: s.getIdNumber(), reverse=True):
        if _applies(each, given, wmi):
            parts = [wmi.get_element(r["dst"]) for r in each.getRelations("-1", HAS_PARAMETER)]
            return {part.label: list(part.getProperty(VALUE).values) for part in parts if part.hasProperty(VALUE)}
    return {}


def has_learned_values(stype: str, wmi: WorldModelPort) -> bool:
    """Whether there is a set for a type of skill."""
    return bool(_sets(stype, wmi))


def _sets(stype: str, wmi: WorldModelPort) -> list[Element]:
    if not wmi.knows(PARAMETER_SET):  # an older ontology
        return []
    return [s for s in wmi.resolve_elements(Element(PARAMETER_SET)) if s.value_of(SKILL_TYPE) == full_name(stype)]


def _applies(parameter_set: Element, given: Mapping[str, Sequence[Any]], wmi: WorldModelPort) -> bool:
    if not parameter_set.hasProperty(APPLIES_TO):
        return True
    for text in parameter_set.getProperty(APPLIES_TO).values:
        key, _, wanted = str(text).partition("=")
        values = given.get(key, ())
        if not values or not isinstance(values[0], Element) or not is_of_class(values[0].type, wanted, wmi):
            return False
    return True
