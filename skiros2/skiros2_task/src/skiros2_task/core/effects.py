"""Compiles the dependencies between facts of one relation or property away, so that each fact is an own predicate.

A relation holds if one of its subproperties does. Setting a property to a value removes its other values, makes it
have a value, and determines how it compares with numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from skiros2_task.core.formula import Atom, Formula, Kind, Not, Predicate, conjunction, disjunction, literal_formula

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
