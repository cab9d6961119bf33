"""The map between the conditions of skills and the predicates of planning."""

from __future__ import annotations

import math

from skiros2_common.core import conditions
from skiros2_task.core.effects import PROPERTY_KINDS, are_contradictory
from skiros2_task.core.formula import Kind, Predicate
from skiros2_task.core.goal_text import COMPARATORS
from skiros2_task.core.skills import SkillCondition

IN_SCENE = Predicate(Kind.IN_SCENE)

_KINDS = frozenset(Kind)

#: The condition class that tests a predicate of each kind.
_TESTS = {
    Kind.RELATION: conditions.ConditionRelation,
    Kind.ALLOWED: conditions.AbstractConditionRelation,
    Kind.VALUE: conditions.ConditionProperty,
    Kind.COMPARES: conditions.ConditionProperty,
    Kind.HAS: conditions.ConditionHasProperty,
    Kind.IS_A: conditions.ConditionOnType,
    Kind.IN_SCENE: conditions.ConditionIsSpecified,
}

class Unusable(Exception):
    """Why planning cannot use a skill."""


def predicate_of(condition: SkillCondition) -> Predicate | None:
    """Returns the predicate of a condition; None if the condition is not a predicate of elements.

    :raises Unusable: the condition is malformed.
    """
    if condition.planned_as not in _KINDS:
        return None
    kind, name = Kind(condition.planned_as), condition.name
    if kind is Kind.IN_SCENE:
        return IN_SCENE
    if not name:
        raise Unusable(f"condition {condition.label!r} does not name its relation, property or class")
    if kind is not Kind.VALUE:
        return Predicate(kind, name)
    operator, value = condition.operator, condition.value
    if operator not in COMPARATORS:
        raise Unusable(f"condition {condition.label!r} has the operator {operator!r}, expected one of = > < >= <=")
    if operator == "=" and isinstance(value, str | bool):
        return Predicate(Kind.VALUE, name, value)
    try:
        number = math.nan if value is None else float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise Unusable(f"condition {condition.label!r} compares {name} {operator} {value!r}, expected a number")
    return Predicate(Kind.COMPARES, name, number, operator)


def condition_of(predicate: Predicate, subject: str, obj: str) -> SkillCondition:
    """Returns the condition that tests a predicate.

    :param subject, obj: the keys of its parameters.
    """
    return SkillCondition(
        _TESTS[predicate.kind].__name__,
        str(predicate),
        subject,
        obj if predicate.arity == 2 else "",
        predicate.name,
        predicate.operator or "=",
        predicate.value,
    )


def contradict(one: SkillCondition, other: SkillCondition) -> bool:
    """Whether two conditions can never hold together.

    :raises Unusable: one of them is malformed.
    """
    if one.contradicts(other):
        return True
    first, second = predicate_of(one), predicate_of(other)
    if first is None or second is None or not {first.kind, second.kind} <= PROPERTY_KINDS:
        return False
    if (one.subject, first.name) != (other.subject, second.name):
        return False
    return are_contradictory((first, one.state), (second, other.state))
