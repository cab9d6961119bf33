"""A goal as lines, each a condition that is built from lists: subject, relation or property, object or value."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_task.core.goal_reader import ANY_OBJECT
from skiros2_task.core.goal_text import (
    COMPARATORS,
    Name,
    ParsedAtom,
    ParsedComparison,
    ParsedEquality,
    ParsedGoal,
    ParsedJunction,
    ParsedNot,
    ParsedQuantifier,
    parse_goals,
)

#: The quantifiers of a class as subject or object.
EVERY, SOME = "every", "some"

#: The operator of a property without a value to compare: it is true, or has any value.
HOLDS = "holds"
OPERATORS = (*COMPARATORS, HOLDS)

_SPECIAL = re.compile(r"[\s(),;]")
_VARIABLES = ("?x", "?y")


@dataclass(frozen=True)
class Term:
    """The subject or object of a line.

    :param name: an element as written in the goal (id or label), or a class; "" if it is not chosen yet.
    :param quantifier: `EVERY` or `SOME` element of the class; "" for an element.
    """

    name: str = ""
    quantifier: str = ""


@dataclass(frozen=True)
class Line:
    """A condition of a goal.

    :param predicate: the relation, or the property; "" if it is not chosen yet.
    :param operator: one of `OPERATORS` for a property; "" for a relation.
    :param object: of a relation.
    :param value: compared with the property.
    :param is_negated: whether the condition must not hold.
    :param text: a condition that lines cannot express; the other fields are unused.
    """

    subject: Term = Term()
    predicate: str = ""
    operator: str = ""
    object: Term = Term()
    value: float | str = ""
    is_negated: bool = False
    text: str = ""

    @property
    def is_complete(self) -> bool:
        """Whether it is part of the goal."""
        if self.text:
            return True
        if not self.subject.name or not self.predicate:
            return False
        if not self.operator:
            return bool(self.object.name)
        return self.operator == HOLDS or self.value != ""


def read_lines(text: str) -> tuple[Line, ...]:
    """Returns the lines of a goal: its top-level conditions.

    :raises GoalError: the text does not parse.
    """
    return tuple(_line(part) for goal in parse_goals(text) for part in _conjuncts(goal))


def write_lines(lines: Iterable[Line]) -> str:
    """Returns the text of a goal; incomplete lines are left out."""
    return ", ".join(_text(line) for line in lines if line.is_complete)


def quoted(text: str) -> str:
    """Returns a name as written in a goal: in quotes if it is empty or has other signs."""
    return f'"{text}"' if _SPECIAL.search(text) or not text else text


def value_of(text: str) -> float | str:
    """Returns the finite number that a text is, or else the text."""
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) else text


def number_text(number: float) -> str:
    """Returns a number as written, whole numbers without fraction."""
    return str(int(number)) if number.is_integer() else repr(number)


# -- reading -------------------------------------------------------------------------------------------------------


def _conjuncts(goal: ParsedGoal) -> Iterable[ParsedGoal]:
    if isinstance(goal, ParsedJunction) and goal.every:
        for part in goal.parts:
            yield from _conjuncts(part)
    else:
        yield goal


def _line(goal: ParsedGoal) -> Line:
    variables: list[tuple[str, Term]] = []
    body = goal
    while isinstance(body, ParsedQuantifier) and len(body.variables) == 1:
        variable, cls = body.variables[0]
        variables.append((variable.text, Term(ANY_OBJECT if cls is None else cls.text, EVERY if body.every else SOME)))
        body = body.body
    is_negated = isinstance(body, ParsedNot)
    if isinstance(body, ParsedNot):
        body = body.part
    names: tuple[Name, ...] = ()
    if isinstance(body, ParsedAtom) and len(body.terms) in (1, 2):
        names = body.terms
    elif isinstance(body, ParsedComparison):
        names = (body.subject,)
    # Each variable stands once, in the order of the quantifiers: other orders mean something else.
    if not names or [n.text for n in names if n.text.startswith("?")] != [name for name, _ in variables]:
        return Line(text=_goal_text(goal))
    of_variable = dict(variables)
    terms = [of_variable.get(name.text) or Term(name.text) for name in names]
    if isinstance(body, ParsedComparison):
        return Line(terms[0], body.property.text, body.operator, value=body.value, is_negated=is_negated)
    assert isinstance(body, ParsedAtom)
    if len(terms) == 1:
        return Line(terms[0], body.predicate.text, HOLDS, is_negated=is_negated)
    return Line(terms[0], body.predicate.text, "", terms[1], is_negated=is_negated)


# -- writing -------------------------------------------------------------------------------------------------------


def _text(line: Line) -> str:
    if line.text:
        return line.text
    terms = [line.subject] if line.operator else [line.subject, line.object]
    names: list[str] = []
    quantifiers: list[str] = []
    for term, variable in zip(terms, _VARIABLES, strict=False):
        names.append(variable if term.quantifier else quoted(term.name))
        if term.quantifier:
            word = "forall" if term.quantifier == EVERY else "exists"
            quantifiers.append(f"({word} ({variable} - {quoted(term.name)}) ")
    text = f"({quoted(line.predicate)} {' '.join(names)})"
    if line.operator in COMPARATORS:
        text = f"({line.operator} {text} {_value_text(line.value)})"
    if line.is_negated:
        text = f"(not {text})"
    return f"{''.join(quantifiers)}{text}{')' * len(quantifiers)}"


def _value_text(value: float | str) -> str:
    if isinstance(value, float):
        return number_text(value)
    return f'"{value}"' if isinstance(value_of(value), float) else quoted(value)


def _goal_text(goal: ParsedGoal) -> str:
    """Returns the text of any goal."""
    if isinstance(goal, ParsedAtom):
        return f"({' '.join(quoted(name.text) for name in (goal.predicate, *goal.terms))})"
    if isinstance(goal, ParsedComparison):
        subject = f"({quoted(goal.property.text)} {quoted(goal.subject.text)})"
        return f"({goal.operator} {subject} {_value_text(goal.value)})"
    if isinstance(goal, ParsedEquality):
        return f"(= {quoted(goal.one.text)} {quoted(goal.other.text)})"
    if isinstance(goal, ParsedNot):
        return f"(not {_goal_text(goal.part)})"
    if isinstance(goal, ParsedJunction):
        return f"({' '.join(['and' if goal.every else 'or', *map(_goal_text, goal.parts)])})"
    variables = " ".join(f"{name.text} - {ANY_OBJECT if cls is None else cls.text}" for name, cls in goal.variables)
    return f"({'forall' if goal.every else 'exists'} ({variables}) {_goal_text(goal.body)})"
