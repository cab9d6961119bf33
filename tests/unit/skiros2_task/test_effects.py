"""Dependencies between facts of one relation or property."""

from __future__ import annotations

import pytest

from skiros2_task.core.conditions import FactFamilies
from skiros2_task.core.formula import Atom, Kind, Not, Or, Predicate


def relation(name: str) -> Predicate:
    return Predicate(Kind.RELATION, name)


def value(of: str | bool, prop: str = "State") -> Predicate:
    return Predicate(Kind.VALUE, prop, of)


def compares(operator: str, number: float, prop: str = "Weight") -> Predicate:
    return Predicate(Kind.COMPARES, prop, number, operator)


def has(prop: str) -> Predicate:
    return Predicate(Kind.HAS, prop)


ABOVE = {"contain": "spatiallyRelated", "hasA": "spatiallyRelated"}


def families(*changed: Predicate) -> FactFamilies:
    return FactFamilies(changed, lambda child, parent: child == parent or ABOVE.get(child) == parent)


def after(effect: Predicate, state: bool, *used: Predicate) -> dict[Predicate, bool]:
    return dict(families(effect).consequences(effect, state, used))


def test_relation_expands_to_changed_subproperties() -> None:
    atom = Atom(relation("spatiallyRelated"), ("a", "b"))
    contains = Atom(relation("contain"), ("a", "b"))
    facts = families(relation("contain"), relation("at"))
    assert facts.literal(atom, True) == Or((atom, contains))
    assert facts.literal(atom, False).parts == (Not(atom), Not(contains))  # type: ignore[union-attr]
    assert families(relation("at")).literal(atom, True) == atom


def test_deleting_relation_deletes_subproperties() -> None:
    used = (relation("spatiallyRelated"), relation("contain"), relation("at"))
    assert after(relation("spatiallyRelated"), False, *used) == {used[0]: False, used[1]: False}
    assert after(relation("contain"), False, *used) == {used[1]: False}
    assert after(relation("contain"), True, *used) == {used[1]: True}


def test_new_value_replaces_others() -> None:
    used = (value("Full"), value("Empty"), value("Full", "Other"), has("State"))
    assert after(value("Full"), True, *used) == {used[0]: True, used[1]: False, used[3]: True}


def test_deleted_text_keeps_other_values() -> None:
    assert after(value("Full"), False, value("Full"), value("Empty")) == {value("Full"): False}


def test_negated_true_is_false() -> None:
    used = (value(True), value(False))
    assert after(value(True), False, *used) == {value(True): False, value(False): True}
    assert after(value(False), True, *used) == {value(True): False, value(False): True}


def test_deleted_property_has_no_value() -> None:
    used = (value("Full"), compares(">", 1.0, "State"), has("State"))
    assert after(has("State"), False, *used) == dict.fromkeys(used, False)
    assert after(has("State"), True, *used) == {has("State"): True}


@pytest.mark.parametrize(
    ("effect", "state", "asked", "holds"),
    [
        (compares("=", 5.0), True, compares(">", 3.0), True),
        (compares("=", 5.0), True, compares(">", 5.0), False),
        (compares("=", 5.0), True, compares(">=", 5.0), True),
        (compares("=", 5.0), True, compares("=", 5.0), True),
        (compares(">", 5.0), True, compares(">=", 5.0), True),
        (compares(">=", 5.0), True, compares(">", 5.0), False),
        (compares(">", 5.0), True, compares(">", 7.0), False),
        (compares(">", 5.0), True, compares("<", 9.0), False),
        (compares("<", 2.0), True, compares("<=", 2.0), True),
        (compares(">", 5.0), False, compares("<=", 5.0), True),
        (compares(">", 5.0), False, compares("<", 6.0), True),
        (compares("=", 5.0), False, compares("<", 6.0), False),
    ],
)
def test_numeric_effect_decides_implied_comparisons(
    effect: Predicate, state: bool, asked: Predicate, holds: bool
) -> None:
    assert after(effect, state, asked) == {asked: holds}


def test_negated_comparison_includes_missing_value() -> None:
    atom = Atom(compares(">", 5.0), ("a",))
    expected = Or((Atom(compares("<=", 5.0), ("a",)), Not(Atom(has("Weight"), ("a",)))))
    assert families().literal(atom, False) == expected
