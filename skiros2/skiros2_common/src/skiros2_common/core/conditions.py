"""Conditions of skills over the world model.

A condition has a label, the keys of the parameters it speaks of, and a desired state. In all of them `ph` is the
`ParamHandler` of the skill and `wmi` the world model. Facts are read from the world model at each evaluation. A fact
about an unset parameter, a missing property or an element that does not exist is false.
"""

from skiros2_common.core.condition import ConditionBase
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
]
