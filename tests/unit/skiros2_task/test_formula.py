"""Predicates and formulas."""

from __future__ import annotations

import pytest

from skiros2_task.core.formula import (
    FALSE,
    TRUE,
    And,
    Atom,
    Exists,
    ForAll,
    Formula,
    Kind,
    Not,
    Or,
    Predicate,
    bind,
    conjunction,
    disjunction,
    expand_quantifiers,
    holds,
    literal_formula,
    literals,
    rewrite,
)

PAINTED = Predicate(Kind.VALUE, "State", "Painted")
IN = Predicate(Kind.RELATION, "skiros:contain")


def painted(term: str) -> Atom:
    return Atom(PAINTED, (term,))


A, B, C = painted("a"), painted("b"), painted("c")


def test_conjunction_is_flat_without_duplicates() -> None:
    assert conjunction([A, And((B, A)), TRUE]) == And((A, B))
    assert conjunction([A]) == A
    assert conjunction([A, FALSE]) == FALSE
    assert conjunction([]) == TRUE


def test_disjunction_is_flat_without_duplicates() -> None:
    assert disjunction([A, Or((B, A)), FALSE]) == Or((A, B))
    assert disjunction([A, TRUE]) == TRUE
    assert disjunction([]) == FALSE


@pytest.mark.parametrize(
    ("formula", "answer"),
    [
        (A, True),
        (B, False),
        (Not(B), True),
        (And((A, Not(B))), True),
        (And((A, B)), False),
        (Or((B, A)), True),
        (TRUE, True),
        (FALSE, False),
    ],
)
def test_holds_evaluates_formula(formula: Formula, answer: bool) -> None:
    assert holds(formula, {A}) is answer


def test_rewrite_returns_negation_normal_form() -> None:
    formula = Not(And((A, Or((Not(B), C)))))
    assert rewrite(formula, literal_formula) == Or((Not(A), And((B, Not(C)))))


def test_rewrite_swaps_negated_quantifier() -> None:
    every = ForAll((("?x", "skiros:Product"),), painted("?x"))
    assert rewrite(Not(every), literal_formula) == Exists(every.variables, Not(painted("?x")))


def test_literals_have_polarity() -> None:
    assert list(literals(And((A, Not(Or((B, Not(C)))))))) == [(A, True), (B, False), (C, True)]


def test_bind_replaces_variables_and_pushes_negations() -> None:
    formula = Not(And((painted("?x"), B)))
    assert bind(formula, {"?x": "a"}) == Or((Not(A), Not(B)))


def test_quantifiers_are_expanded() -> None:
    things = {"T": ("a", "b"), "U": ("u",), "Nothing": ()}.__getitem__
    inside = Atom(IN, ("?u", "?t"))
    every = ForAll((("?t", "T"), ("?u", "U")), inside)
    assert expand_quantifiers(every, things) == And((Atom(IN, ("u", "a")), Atom(IN, ("u", "b"))))
    some = ForAll((("?u", "U"),), Exists((("?t", "T"),), inside))
    assert expand_quantifiers(some, things) == Or((Atom(IN, ("u", "a")), Atom(IN, ("u", "b"))))
    assert expand_quantifiers(ForAll((("?n", "Nothing"),), painted("?n")), things) == TRUE
    assert expand_quantifiers(Exists((("?n", "Nothing"),), painted("?n")), things) == FALSE


def test_formula_text_is_goal_syntax() -> None:
    heavy = Atom(Predicate(Kind.COMPARES, "skiros:Weight", 2.0, ">"), ("a",))
    formula = And((Atom(IN, ("t", "a")), Not(A), heavy))
    assert str(formula) == "(and (skiros:contain t a) (not (State_Painted a)) (> (skiros:Weight a) 2))"
