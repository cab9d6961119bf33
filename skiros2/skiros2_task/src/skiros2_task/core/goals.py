"""Goals as Python objects, for programs that need not write their text.

tray, part = wm.get_element("demo:Tray-12"), "skiros:Product-14"
goal = all_of(related(tray, "skiros:contain", part), negated(equals(part, "skiros:Surface", "Raw")))
goal = for_all("skiros:Product", lambda x: related(tray, "skiros:contain", x))

`str(goal)` is its text. Names and ids are looked up when the goal is planned for.
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
from skiros2_task.core.goal_syntax import COMPARATORS

#: An element, its id, the name of a template, or what `for_all` and `exists` give.
Thing = Element | str


def related(subject: Thing, relation: str, obj: Thing) -> Formula:
    """A relation, or one under it, holds."""
    return Atom(Predicate(Kind.RELATION, full_name(relation)), (_term(subject), _term(obj)))


def equals(subject: Thing, prop: str, value: str | bool | float = True) -> Formula:
    """A value is among those of a property."""
    if isinstance(value, bool | str):
        return Atom(Predicate(Kind.VALUE, full_name(prop), value), (_term(subject),))
    return compares(subject, prop, "=", value)


def compares(subject: Thing, prop: str, operator: str, number: float) -> Formula:
    """A property's value compares so with a number.

    :param operator: one of `= > < >= <=`.
    :raises WrongValue: the operator is another one.
    """
    if operator not in COMPARATORS:
        raise WrongValue(f"goal on {prop}: operator {operator!r}, expected one of {' '.join(COMPARATORS)}")
    return Atom(Predicate(Kind.COMPARES, full_name(prop), float(number), operator), (_term(subject),))


def has(subject: Thing, prop: str) -> Formula:
    """A property has a value."""
    return Atom(Predicate(Kind.HAS, full_name(prop)), (_term(subject),))


def is_same(one: Thing, other: Thing) -> Formula:
    """Both are the same element."""
    return same(_term(one), _term(other))


def negated(goal: Formula) -> Formula:
    """It does not hold."""
    return Not(goal)


def all_of(*goals: Formula) -> Formula:
    """All of them hold."""
    return conjunction(goals)


def any_of(*goals: Formula) -> Formula:
    """One of them holds, or more."""
    return disjunction(goals)


def for_all(cls: str, goal: Callable[[str], Formula]) -> Formula:
    """It holds for each element of a class.

    :param goal: makes the goal for one of them.
    """
    variable, body = _body(goal)
    return ForAll(((variable, full_name(cls)),), body)


def exists(cls: str, goal: Callable[[str], Formula]) -> Formula:
    """It holds for some element of a class.

    :param goal: makes the goal for it.
    """
    variable, body = _body(goal)
    return Exists(((variable, full_name(cls)),), body)


def _body(goal: Callable[[str], Formula]) -> tuple[str, Formula]:
    """A variable and the goal about it. Variables are numbered from within, so that no two in each other are equal."""
    depth = _depth(goal("?x"))
    variable = f"?x{depth + 1}"
    return variable, goal(variable)


def _depth(goal: Formula) -> int:
    """How many quantifiers stand in each other."""
    if isinstance(goal, ForAll | Exists):
        return 1 + _depth(goal.body)
    if isinstance(goal, Atom):
        return 0
    return max(map(_depth, (goal.part,) if isinstance(goal, Not) else goal.parts), default=0)


def _term(thing: Thing) -> str:
    if isinstance(thing, str):
        return thing
    if not isinstance(thing, Element):
        raise WrongType(f"goal about {thing!r}: expected an element or its id, found {type(thing).__name__}")
    if thing.isAbstract() and not thing.label:
        raise WrongValue(f"goal about {thing!r}: it has neither id nor label; use exists or for_all for its class")
    return thing.id or thing.label
