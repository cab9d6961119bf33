"""Conditions of skills over the world model.

A condition has a label, the keys of its parameters, and a desired state. `ph` is always the `ParamHandler` of the skill
and `wmi` the world model. Each evaluation reads the facts from the world model. A fact about an unset parameter, a
missing property or a missing element is false.
"""

from skiros2_common.core.condition import ConditionBase, condition_from
from skiros2_common.core.or_condition import ConditionOr
from skiros2_common.core.property_conditions import ConditionHasProperty, ConditionProperty
from skiros2_common.core.relation_conditions import AbstractConditionRelation, ConditionRelation
from skiros2_common.core.value_conditions import (
    ConditionFunction,
    ConditionGenerate,
    ConditionIsSpecified,
    ConditionOnType,
)

__all__ = [
    "AbstractConditionRelation",
    "ConditionBase",
    "ConditionFunction",
    "ConditionGenerate",
    "ConditionHasProperty",
    "ConditionIsSpecified",
    "ConditionOnType",
    "ConditionOr",
    "ConditionProperty",
    "ConditionRelation",
    "condition_from",
]
