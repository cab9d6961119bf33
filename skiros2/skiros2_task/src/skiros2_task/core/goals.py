"""Builds goals in Python, without care for quotes, commas and prefixes.

tray, part = wm.get_element("demo:Tray-12"), "skiros:Product-14"
goal = all_of(related(tray, "skiros:contain", part), negated(equals(part, "skiros:Surface", "Raw")))
goal = for_all("skiros:Product", lambda x: related(tray, "skiros:contain", x))

A goal is its text.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element
from skiros2_task.core.formula import Atom, Kind, Predicate, quoted
from skiros2_task.core.goal_text import COMPARATORS

#: An element, its id, the name of a template, or a variable of `for_all` or `exists`.
Term = Element | str


def related(subject: Term, relation: str, obj: Term) -> str:
    """The relation, or a subproperty of it, holds."""
    return str(Atom(Predicate(Kind.RELATION, full_name(relation)), (_term(subject), _term(obj))))


def equals(subject: Term, prop: str, value: str | bool | float = True) -> str:
    """The property has the value."""
    if isinstance(value, bool | str):
        return str(Atom(Predicate(Kind.VALUE, full_name(prop), value), (_term(subject),)))
    return compares(subject, prop, "=", value)


def compares(subject: Term, prop: str, operator: str, number: float) -> str:
    """The comparison of the property's value with the number holds.

    :param operator: one of `= > < >= <=`.
    :raises WrongValue: the operator is unknown.
    """
    if operator not in COMPARATORS:
        raise WrongValue(f"goal on {prop}: operator {operator!r}, expected one of {' '.join(COMPARATORS)}")
    return str(Atom(Predicate(Kind.COMPARES, full_name(prop), float(number), operator), (_term(subject),)))


def has(subject: Term, prop: str) -> str:
    """The property has a value."""
    return str(Atom(Predicate(Kind.HAS, full_name(prop)), (_term(subject),)))


def is_same(one: Term, other: Term) -> str:
    """Both are the same element."""
    return f"(= {quoted(_term(one))} {quoted(_term(other))})"


def negated(goal: str) -> str:
    """The goal does not hold."""
    return f"(not {goal})"


def all_of(*goals: str) -> str:
    """All goals hold."""
    return f"({' '.join(('and', *goals))})"


def any_of(*goals: str) -> str:
    """At least one goal holds."""
    return f"({' '.join(('or', *goals))})"


def for_all(cls: str, goal: Callable[[str], str]) -> str:
    """The goal holds for each element of the class.

    :param goal: returns the goal for an element.
    """
    return _quantified("forall", cls, goal)


def exists(cls: str, goal: Callable[[str], str]) -> str:
    """The goal holds for some element of the class.

    :param goal: returns the goal for the element.
    """
    return _quantified("exists", cls, goal)


def _quantified(word: str, cls: str, goal: Callable[[str], str]) -> str:
    """Numbers the variables from the inside, so that nested ones are distinct."""
    inner = re.findall(r"\((?:forall|exists) \(\?x(\d+) ", goal("?x"))
    variable = f"?x{max(map(int, inner), default=0) + 1}"
    return f"({word} ({variable} - {quoted(full_name(cls))}) {goal(variable)})"


def _term(term: Term) -> str:
    if isinstance(term, str):
        return term
    if not isinstance(term, Element):
        raise WrongType(f"goal about {term!r}: expected an element or its id, found {type(term).__name__}")
    if term.isAbstract() and not term.label:
        raise WrongValue(f"goal about {term!r}: it has neither id nor label; use exists or for_all for its class")
    return term.id or term.label
