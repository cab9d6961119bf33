"""Builds goals as Python objects.

tray, part = wm.get_element("demo:Tray-12"), "skiros:Product-14"
goal = all_of(related(tray, "skiros:contain", part), negated(equals(part, "skiros:Surface", "Raw")))
goal = for_all("skiros:Product", lambda x: related(tray, "skiros:contain", x))

`str(goal)` is the goal text. Names and ids are resolved by the planner.
"""

from __future__ import annotations

from collections.abc import Callable

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_task.core.formula import (
    Atom,
    Exists,
    ForAll,
    Formula,
    Kind,
    Not,
    Predicate,
    conjunction,
    disjunction,
    same,
)
from skiros2_task.core.goal_text import COMPARATORS

#: An element, its id, the name of a template, or a variable of `for_all` or `exists`.
Term = Element | str


def related(subject: Term, relation: str, obj: Term) -> Formula:
    """The relation, or a subproperty of it, holds."""
    return Atom(Predicate(Kind.RELATION, full_name(relation)), (_term(subject), _term(obj)))


def equals(subject: Term, prop: str, value: str | bool | float = True) -> Formula:
    """The property has the value."""
    if isinstance(value, bool | str):
        return Atom(Predicate(Kind.VALUE, full_name(prop), value), (_term(subject),))
    return compares(subject, prop, "=", value)


def compares(subject: Term, prop: str, operator: str, number: float) -> Formula:
    """The comparison of the property's value with the number holds.

    :param operator: one of `= > < >= <=`.
    :raises WrongValue: the operator is unknown.
    """
    if operator not in COMPARATORS:
        raise WrongValue(f"goal on {prop}: operator {operator!r}, expected one of {' '.join(COMPARATORS)}")
    return Atom(Predicate(Kind.COMPARES, full_name(prop), float(number), operator), (_term(subject),))


def has(subject: Term, prop: str) -> Formula:
    """The property has a value."""
    return Atom(Predicate(Kind.HAS, full_name(prop)), (_term(subject),))


def is_same(one: Term, other: Term) -> Formula:
    """Both are the same element."""
    return same(_term(one), _term(other))


def negated(goal: Formula) -> Formula:
    """The goal does not hold."""
    return Not(goal)


def all_of(*goals: Formula) -> Formula:
    """All goals hold."""
    return conjunction(goals)


def any_of(*goals: Formula) -> Formula:
    """At least one goal holds."""
    return disjunction(goals)


def for_all(cls: str, goal: Callable[[str], Formula]) -> Formula:
    """The goal holds for each element of the class.

    :param goal: returns the goal for an element.
    """
    variable, body = _body(goal)
    return ForAll(((variable, full_name(cls)),), body)


def exists(cls: str, goal: Callable[[str], Formula]) -> Formula:
    """The goal holds for some element of the class.

    :param goal: returns the goal for the element.
    """
    variable, body = _body(goal)
    return Exists(((variable, full_name(cls)),), body)


def _body(goal: Callable[[str], Formula]) -> tuple[str, Formula]:
    """Returns a variable and the goal for it. Variables are numbered from the inside, so nested ones are distinct."""
    depth = _depth(goal("?x"))
    variable = f"?x{depth + 1}"
    return variable, goal(variable)


def _depth(goal: Formula) -> int:
    """Returns the depth of nested quantifiers."""
    if isinstance(goal, ForAll | Exists):
        return 1 + _depth(goal.body)
    if isinstance(goal, Atom):
        return 0
    return max(map(_depth, (goal.part,) if isinstance(goal, Not) else goal.parts), default=0)


def _term(term: Term) -> str:
    if isinstance(term, str):
        return term
    if not isinstance(term, Element):
        raise WrongType(f"goal about {term!r}: expected an element or its id, found {type(term).__name__}")
    if term.isAbstract() and not term.label:
        raise WrongValue(f"goal about {term!r}: it has neither id nor label; use exists or for_all for its class")
    return term.id or term.label
