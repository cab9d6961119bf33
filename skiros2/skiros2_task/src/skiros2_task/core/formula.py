"""Predicates and formulas of conditions, effects and goals.

Names are those of the ontology and ids of elements; a term that starts with `?` is a variable. `pddl_names` maps them
to PDDL. `str()` of a formula is its goal text, which parses to the same formula if goals can express it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import product
from math import prod

from skiros2_common.core.errors import WrongValue

#: The largest expansion of a quantifier.
MAX_INSTANCES = 100_000

#: Characters that end an unquoted name in a goal.
_NEEDS_QUOTES = re.compile(r'[\s(),;"]')


class Kind(Enum):
    """The kind of fact that a predicate states."""

    RELATION = "relation"  # (x, y) are related
    ALLOWED = "allowed"  # the ontology allows the relation between x and y
    VALUE = "value"  # a text or bool is among the values of x's property
    COMPARES = "compares"  # the first value of x's property compares with a number
    HAS = "has"  # x's property has a value
    IS_A = "is a"  # x is an instance of a class
    IN_SCENE = "in scene"  # x exists
    CAN = "can"  # robot x has a skill
    SAME = "="  # x is y


_IN_GOALS = frozenset({Kind.RELATION, Kind.VALUE, Kind.COMPARES, Kind.HAS, Kind.SAME})


@dataclass(frozen=True)
class Predicate:
    """A predicate.

    :param name: the relation, property, class or skill.
    :param value: of VALUE a str or bool, of COMPARES a number.
    :param operator: of COMPARES one of `= > < >= <=`.
    """

    kind: Kind
    name: str = ""
    value: str | bool | float | None = None
    operator: str = ""

    @property
    def arity(self) -> int:
        """The number of terms."""
        return 2 if self.kind in (Kind.RELATION, Kind.ALLOWED, Kind.SAME) else 1

    def __str__(self) -> str:
        if self.kind is Kind.VALUE:
            return self.name if self.value is True else f"{self.name}_{self.value}"
        if self.kind is Kind.COMPARES:
            return f"{self.name} {self.operator} {_number(self.value)}"
        if self.kind is Kind.RELATION:
            return self.name
        if self.kind is Kind.HAS:
            return f"has_{self.name}"
        return f"{self.kind.value} {self.name}".rstrip()


@dataclass(frozen=True)
class Atom:
    """A predicate with terms (ids of elements, or variables)."""

    predicate: Predicate
    terms: tuple[str, ...]

    def __str__(self) -> str:
        if self.predicate.kind is Kind.COMPARES:
            p = self.predicate
            return f"({p.operator} ({quoted(p.name)} {quoted(self.terms[0])}) {_number(p.value)})"
        word = str(self.predicate)
        name = quoted(word) if self.predicate.kind in _IN_GOALS else word
        return f"({' '.join((name, *map(quoted, self.terms)))})"


@dataclass(frozen=True)
class Not:
    part: Formula

    def __str__(self) -> str:
        return f"(not {self.part})"


@dataclass(frozen=True)
class And:
    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return f"(and {' '.join(str(p) for p in self.parts)})" if self.parts else "(and)"


@dataclass(frozen=True)
class Or:
    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return f"(or {' '.join(str(p) for p in self.parts)})" if self.parts else "(or)"


@dataclass(frozen=True)
class ForAll:
    """The body holds for all elements of the variables' classes."""

    variables: tuple[tuple[str, str], ...]  # (variable, class)
    body: Formula

    def __str__(self) -> str:
        return f"(forall ({_typed(self.variables)}) {self.body})"


@dataclass(frozen=True)
class Exists:
    """The body holds for some elements of the variables' classes."""

    variables: tuple[tuple[str, str], ...]
    body: Formula

    def __str__(self) -> str:
        return f"(exists ({_typed(self.variables)}) {self.body})"


Formula = Atom | Not | And | Or | ForAll | Exists

TRUE = And(())
FALSE = Or(())


def _typed(variables: Sequence[tuple[str, str]]) -> str:
    return " ".join(f"{variable} - {quoted(cls)}" for variable, cls in variables)


def quoted(name: str) -> str:
    """Returns a name as goals write it, in quotes if needed. Quotes and line breaks in the name become `_`."""
    if name and not _NEEDS_QUOTES.search(name):
        return name
    return '"' + re.sub(r'["\n]', "_", name) + '"'


def _number(value: object) -> str:
    """Returns a number with all its digits."""
    text = repr(float(value))  # type: ignore[arg-type]
    return text.removesuffix(".0")


def same(one: str, other: str) -> Formula:
    """Returns the equality of two terms; TRUE or FALSE if both are constants."""
    if one == other:
        return TRUE
    if one.startswith("?") or other.startswith("?"):
        return Atom(Predicate(Kind.SAME), (one, other))
    return FALSE


def conjunction(parts: Iterable[Formula]) -> Formula:
    """Returns the flattened conjunction, without duplicates and TRUE."""
    flat: dict[Formula, None] = {}
    for part in parts:
        if part == FALSE:
            return FALSE
        for item in part.parts if isinstance(part, And) else (part,):
            flat[item] = None
    return next(iter(flat)) if len(flat) == 1 else And(tuple(flat))


def disjunction(parts: Iterable[Formula]) -> Formula:
    """Returns the flattened disjunction, without duplicates and FALSE."""
    flat: dict[Formula, None] = {}
    for part in parts:
        if part == TRUE:
            return TRUE
        for item in part.parts if isinstance(part, Or) else (part,):
            flat[item] = None
    return next(iter(flat)) if len(flat) == 1 else Or(tuple(flat))


def negation(formula: Formula) -> Formula:
    """Returns the negation, with TRUE and FALSE simplified."""
    return FALSE if formula == TRUE else TRUE if formula == FALSE else Not(formula)


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """Returns the parts of a conjunction; any other formula as its only part."""
    return formula.parts if isinstance(formula, And) else (formula,)


def rewrite(formula: Formula, positive: Callable[[Atom], Formula], negative: Callable[[Atom], Formula]) -> Formula:
    """Returns the formula in negation normal form, with each literal replaced.

    :param positive: returns the replacement of an atom.
    :param negative: returns the replacement of a negated atom.
    """
    return _rewrite(formula, True, positive, negative)


def _rewrite(
    formula: Formula, state: bool, positive: Callable[[Atom], Formula], negative: Callable[[Atom], Formula]
) -> Formula:
    if isinstance(formula, Atom):
        return positive(formula) if state else negative(formula)
    if isinstance(formula, Not):
        return _rewrite(formula.part, not state, positive, negative)
    if isinstance(formula, And | Or):
        parts = [_rewrite(part, state, positive, negative) for part in formula.parts]
        return conjunction(parts) if isinstance(formula, And) == state else disjunction(parts)
    body = _rewrite(formula.body, state, positive, negative)
    return (ForAll if isinstance(formula, ForAll) == state else Exists)(formula.variables, body)


def literals(formula: Formula) -> Iterator[tuple[Atom, bool]]:
    """Yields the literals of a formula in negation normal form, as (atom, is positive) pairs."""
    stack: list[tuple[Formula, bool]] = [(formula, True)]
    while stack:
        item, state = stack.pop()
        if isinstance(item, Atom):
            yield item, state
        elif isinstance(item, Not):
            stack.append((item.part, not state))
        elif isinstance(item, And | Or):
            stack.extend((part, state) for part in reversed(item.parts))
        else:
            stack.append((item.body, state))


def bind(formula: Formula, values: dict[str, str]) -> Formula:
    """Returns the formula with its free variables replaced by values."""
    if isinstance(formula, Atom):
        terms = tuple(values.get(t, t) for t in formula.terms)
        return same(*terms) if formula.predicate.kind is Kind.SAME else Atom(formula.predicate, terms)
    if isinstance(formula, Not):
        return negation(bind(formula.part, values))
    if isinstance(formula, And):
        return conjunction(bind(p, values) for p in formula.parts)
    if isinstance(formula, Or):
        return disjunction(bind(p, values) for p in formula.parts)
    inner = {k: v for k, v in values.items() if k not in dict(formula.variables)}
    return type(formula)(formula.variables, bind(formula.body, inner))


def expand_quantifiers(formula: Formula, members: Callable[[str], Sequence[str]]) -> Formula:
    """Returns the formula with its quantifiers expanded.

    :param members: returns the objects of a class.
    :raises WrongValue: the expansion has more than `MAX_INSTANCES` formulas.
    """
    if isinstance(formula, Atom):
        return formula
    if isinstance(formula, Not):
        return negation(expand_quantifiers(formula.part, members))
    if isinstance(formula, And):
        return conjunction(expand_quantifiers(p, members) for p in formula.parts)
    if isinstance(formula, Or):
        return disjunction(expand_quantifiers(p, members) for p in formula.parts)
    names = [variable for variable, _ in formula.variables]
    body = expand_quantifiers(formula.body, members)
    objects = [members(cls) for _, cls in formula.variables]
    count = prod(map(len, objects))
    if count > MAX_INSTANCES:
        raise WrongValue(f"{formula} expands to {count} formulas, the limit is {MAX_INSTANCES}")
    choices = product(*objects)
    instances = (bind(body, dict(zip(names, choice, strict=True))) for choice in choices)
    return conjunction(instances) if isinstance(formula, ForAll) else disjunction(instances)


def holds(formula: Formula, state: Container[Atom]) -> bool:
    """Whether a ground formula without quantifiers holds in a state, the container of all true atoms."""
    if isinstance(formula, Atom):
        return formula in state
    if isinstance(formula, Not):
        return not holds(formula.part, state)
    if isinstance(formula, And):
        return all(holds(p, state) for p in formula.parts)
    if isinstance(formula, Or):
        return any(holds(p, state) for p in formula.parts)
    raise TypeError(f"{formula} has a quantifier; expand it first")
