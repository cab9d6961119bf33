"""The map between the conditions of skills and the predicates of planning, and the dependencies between these.

A relation holds if one of its subproperties does. Setting a property to a value removes its other values, makes it
have a value, and determines how it compares with numbers. `FactFamilies` compiles these dependencies away, so that each
fact is an own predicate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from skiros2_common.core import conditions
from skiros2_task.core.formula import Atom, Formula, Kind, Not, Predicate, conjunction, disjunction, literal_formula
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


# -- dependencies between facts ----------------------------------------------------------------------------------------

Literal = tuple[Predicate, bool]
Interval = tuple[float, bool, float, bool]  # lower bound, is inclusive, upper bound, is inclusive

#: The predicates of a property.
PROPERTY_KINDS = frozenset({Kind.VALUE, Kind.HAS, Kind.COMPARES})

_COMPLEMENTS = {">": ("<=",), "<": (">=",), ">=": ("<",), "<=": (">",), "=": ("<", ">")}


class FactFamilies:
    """Dependencies between predicates, for one set of skills."""

    def __init__(self, changed: Iterable[Predicate], is_subproperty: Callable[[str, str], bool]) -> None:
        """
        :param changed: the predicates of all effects of all skills.
        :param is_subproperty: whether the first relation equals the second or is a subproperty of it.
        """
        self._changed = sorted({p.name for p in changed if p.kind is Kind.RELATION})
        self._is_subproperty = is_subproperty

    def tracked(self, relation: str) -> list[str]:
        """Returns the relation and those of its subproperties that some skill changes. The others are static."""
        return [relation, *(r for r in self._changed if r != relation and self._is_subproperty(r, relation))]

    def literal(self, atom: Atom, state: bool) -> Formula:
        """Returns the formula that replaces an atom (True) or a negated atom (False) of a condition."""
        predicate = atom.predicate
        if predicate.kind is Kind.RELATION:
            return disjunction(self._each(atom)) if state else conjunction(Not(part) for part in self._each(atom))
        if predicate.kind is Kind.COMPARES and not state:
            # After an effect, a comparison that does not follow from it is false. So conditions must not negate one.
            others = [
                Atom(Predicate(Kind.COMPARES, predicate.name, predicate.value, operator), atom.terms)
                for operator in _COMPLEMENTS[predicate.operator]
            ]
            return disjunction([*others, Not(Atom(Predicate(Kind.HAS, predicate.name), atom.terms))])
        return literal_formula(atom, state)

    def _each(self, atom: Atom) -> list[Atom]:
        return [Atom(Predicate(Kind.RELATION, name), atom.terms) for name in self.tracked(atom.predicate.name)]

    def consequences(self, effect: Predicate, state: bool, used: Iterable[Predicate]) -> list[Literal]:
        """Returns the literals of used predicates, with the effect's terms, that an effect makes true."""
        if effect.kind is Kind.RELATION:
            if state:
                return [(effect, True)] if effect in used else []
            return [
                (p, False)
                for p in used
                if p.kind is Kind.RELATION and (p == effect or self._is_subproperty(p.name, effect.name))
            ]
        if effect.kind not in PROPERTY_KINDS:
            return [(p, state) for p in used if p == effect]
        if effect.kind is Kind.VALUE and isinstance(effect.value, bool) and not state:
            effect, state = Predicate(Kind.VALUE, effect.name, not effect.value), True
        found = []
        for predicate in used:
            if predicate.name == effect.name:
                after = _after(effect, state, predicate)
                if after is not None:
                    found.append((predicate, after))
        return found


def are_contradictory(one: Literal, other: Literal) -> bool:
    """Whether two literals about one property of one element can never be true together."""
    if one == (other[0], not other[1]):
        return True
    if not (one[1] or other[1]):
        return False  # both hold if the property is missing
    (first, first_state), (second, second_state) = one, other
    if (first.kind is Kind.HAS and not first_state) or (second.kind is Kind.HAS and not second_state):
        return True
    if first.kind is second.kind is Kind.COMPARES:
        return _are_disjoint([*_regions(first, first_state), *_regions(second, second_state)])
    if isinstance(first.value, bool) and isinstance(second.value, bool):
        return (first.value == first_state) != (second.value == second_state)
    return False


def _are_disjoint(regions: list[Interval]) -> bool:
    """Whether the intersection of intervals is empty."""
    low, low_out = max((low, not belongs) for low, belongs, _, _ in regions)
    high, high_in = min((high, belongs) for _, _, high, belongs in regions)
    return low > high or (low == high and (low_out or not high_in))


def _after(effect: Predicate, state: bool, predicate: Predicate) -> bool | None:
    """Returns whether a predicate of the same property holds after the effect; None: unchanged."""
    kind = predicate.kind
    if effect.kind is Kind.HAS:
        if state:
            return True if kind is Kind.HAS else None
        return False if kind in (Kind.HAS, Kind.VALUE, Kind.COMPARES) else None
    if kind is Kind.HAS:
        return True if state else None
    if effect.kind is Kind.VALUE:
        if kind is Kind.VALUE:
            return state if predicate.value == effect.value else (False if state else None)
        return False if kind is Kind.COMPARES and state else None
    if kind is Kind.COMPARES:
        return any(_within(region, predicate) for region in _regions(effect, state))
    return False if kind is Kind.VALUE and state else None


def _regions(effect: Predicate, state: bool) -> list[Interval]:
    """Returns the interval of the value after a numeric effect; [] if it is not one interval."""
    operators = (effect.operator,) if state else _COMPLEMENTS[effect.operator]
    return [_interval(operators[0], effect.value)] if len(operators) == 1 else []


def _interval(operator: str, value: object) -> Interval:
    number = float(value)  # type: ignore[arg-type]
    low = number if operator in (">", ">=", "=") else -math.inf
    high = number if operator in ("<", "<=", "=") else math.inf
    return low, operator in (">=", "="), high, operator in ("<=", "=")


def _within(region: Interval, predicate: Predicate) -> bool:
    low, low_in, high, high_in = _interval(predicate.operator, predicate.value)
    below = region[0] > low or (region[0] == low and (low_in or not region[1]))
    above = region[2] < high or (region[2] == high and (high_in or not region[3]))
    return below and above
