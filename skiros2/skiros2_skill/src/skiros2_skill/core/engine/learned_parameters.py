"""Parameter sets: values of a skill's parameters that were learned, as elements of the world model.

A set is an element of class `skiros:ParameterSet` with `skiros:SkillType`. Its parts (`skiros:hasParam`) are values:
`skiros:Parameter` with the key as label and `skiros:Value`. Its `skiros:AppliesTo` restrict it to a kind of task:
texts KEY=CLASS, the class of the element in a parameter.

The values of a policy depend on features of the task. Its further parts are of class `skiros:Feature`: a number of the
element in a parameter, with the label KEY.PROPERTY, and the validated range. Each part of a policy has as many values
as the others: the values of one row belong together, and the row whose features are nearest counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.names import full_name, is_of_class
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort

PARAMETER_SET = "skiros:ParameterSet"
SKILL_TYPE, APPLIES_TO, VALUE = "skiros:SkillType", "skiros:AppliesTo", "skiros:Value"
HAS_PARAMETER = "skiros:hasParam"
FEATURE, LOWEST, HIGHEST = "skiros:Feature", "skiros:LowerBound", "skiros:UpperBound"


@dataclass(frozen=True)
class Learned:
    """Learned values for a start of a skill.

    :param values: by key.
    :param is_policy: whether they depend on the world model at the start.
    :param warning: which features are outside of the validated range; "" if none is.
    """

    values: Mapping[str, list[Any]]
    is_policy: bool = False
    warning: str = ""


def learned_values(stype: str, given: Mapping[str, Sequence[Any]], wmi: WorldModelPort) -> Learned:
    """Returns the learned values for a start of a skill; none without a set. The newest set that applies counts: that
    with the highest number. A policy applies if the elements have its features.

    :param stype: the type of the skill.
    :param given: the values of the request, by key.
    """
    for each in sorted(_sets(stype, wmi), key=lambda s: s.getIdNumber(), reverse=True):
        if not _applies(each, given, wmi):
            continue
        parts = [wmi.get_element(r["dst"]) for r in each.getRelations("-1", HAS_PARAMETER)]
        features = [part for part in parts if part.type == FEATURE]
        values = {
            part.label: list(part.getProperty(VALUE).values)
            for part in parts
            if part.type != FEATURE and part.hasProperty(VALUE)
        }
        if not features:
            return Learned(values)
        found = [_feature_value(feature, given, wmi) for feature in features]
        present = [value for value in found if value is not None]
        if len(present) == len(features):
            return _chosen(values, features, present)
    return Learned({})


def nearest_row(rows: Sequence[Sequence[float]], features: Sequence[float], widths: Sequence[float]) -> int:
    """Returns the index of the row whose features are nearest.

    :param widths: of the range of each feature, the unit of distances in it.
    """

    def distance(index: int) -> float:
        return sum(((a - b) / w) ** 2 for a, b, w in zip(rows[index], features, widths, strict=True))

    return min(range(len(rows)), key=distance)


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


def _feature_value(feature: Element, given: Mapping[str, Sequence[Any]], wmi: WorldModelPort) -> float | None:
    """Returns the present value of a feature; None if there is no such element, or no such number."""
    key, _, name = feature.label.partition(".")
    values = given.get(key, ())
    element = wmi.find_element(values[0].id) if values and isinstance(values[0], Element) else None
    value = element.value_of(name) if element is not None else None
    return float(value) if isinstance(value, int | float) else None


def _chosen(values: Mapping[str, list[Any]], features: Sequence[Element], present: Sequence[float]) -> Learned:
    ranges = [(float(each.value_of(LOWEST)), float(each.value_of(HIGHEST))) for each in features]
    rows = list(zip(*(each.getProperty(VALUE).values for each in features), strict=True))
    row = nearest_row(rows, present, [high - low for low, high in ranges])
    outside = [
        f"{feature.label} is {value:g}, outside of the validated range {low:g} to {high:g}"
        for feature, value, (low, high) in zip(features, present, ranges, strict=True)
        if not low <= value <= high
    ]
    warning = f"learned values: {'; '.join(outside)}" if outside else ""
    return Learned({key: [each[row]] for key, each in values.items()}, True, warning)
