"""Predicates and formulas of conditions, effects and goals.

Names are those of the ontology and ids of elements; a term that starts with `?` is a variable. `pddl_names` maps them
to PDDL. `str()` of a formula is its goal text, which parses to the same formula if goals can express it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from math import prod
from typing import NamedTuple, TypeVar

from skiros2_common.core.errors import WrongValue

#: The largest expansion of a quantifier.
MAX_INSTANCES = 100_000

#: Characters that end an unquoted name in a goal.
_NEEDS_QUOTES = re.compile(r'[\s(),;"]')


class Kind(StrEnum):
    """The kind of fact that a predicate states. A text, because texts are hashed faster than members of an `Enum`."""

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


class Predicate(NamedTuple):
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


class Atom(NamedTuple):
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


#: The variables of a quantifier, each with its class.
Variables = tuple[tuple[str, str], ...]

T = TypeVar("T")


@dataclass(frozen=True)
class Not:
    """True when its part is false."""

    part: Formula

    def __str__(self) -> str:
        return f"(not {self.part})"


@dataclass(frozen=True)
class And:
    """True when all parts are true."""

    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return f"(and {' '.join(str(p) for p in self.parts)})" if self.parts else "(and)"


@dataclass(frozen=True)
class Or:
    """True when one of the parts is true."""

    parts: tuple[Formula, ...]

    def __str__(self) -> str:
        return f"(or {' '.join(str(p) for p in self.parts)})" if self.parts else "(or)"


@dataclass(frozen=True)
class ForAll:
    """The body holds for all elements of the variables' classes."""

    variables: Variables
    body: Formula

    def __str__(self) -> str:
        return f"(forall ({_typed(self.variables)}) {self.body})"


@dataclass(frozen=True)
class Exists:
    """The body holds for some elements of the variables' classes."""

    variables: Variables
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


def literal_formula(atom: Atom, state: bool) -> Formula:
    """Returns the atom, or its negation."""
    return atom if state else Not(atom)


def fold(
    formula: Formula,
    literal: Callable[[Atom, bool], T],
    every: Callable[[Iterable[T]], T],
    some: Callable[[Iterable[T]], T],
    quantifier: Callable[[type[ForAll | Exists], Variables, T], T] | None = None,
    wanted: bool = True,
) -> T:
    """Computes a value of a formula from the values of its parts. Negations are moved to the literals.

    :param literal: returns the value of an atom (True) or of a negated atom (False).
    :param every, some: return the value of a conjunction or a disjunction. The values of its parts are computed on
        demand.
    :param quantifier: returns the value of a quantified formula, from its kind, its variables and the value of its
        body.
    :param wanted: False for the value of the negated formula.
    :raises TypeError: the formula has a quantifier, and `quantifier` is None.
    """
    if isinstance(formula, Atom):
        return literal(formula, wanted)
    if isinstance(formula, Not):
        return fold(formula.part, literal, every, some, quantifier, not wanted)
    if isinstance(formula, And | Or):
        parts = (fold(part, literal, every, some, quantifier, wanted) for part in formula.parts)
        return every(parts) if isinstance(formula, And) == wanted else some(parts)
    if quantifier is None:
        raise TypeError(f"{formula} has a quantifier; expand it first")
    body = fold(formula.body, literal, every, some, quantifier, wanted)
    return quantifier(ForAll if isinstance(formula, ForAll) == wanted else Exists, formula.variables, body)


def rewrite(formula: Formula, literal: Callable[[Atom, bool], Formula]) -> Formula:
    """Returns the formula in negation normal form, with each literal replaced.

    :param literal: returns the replacement of an atom (True) or of a negated atom (False).
    """
    return fold(formula, literal, conjunction, disjunction, lambda kind, variables, body: kind(variables, body))


def literals(formula: Formula) -> list[tuple[Atom, bool]]:
    """Returns the literals of a formula in negation normal form, as (atom, is positive) pairs."""

    def joined(parts: Iterable[list[tuple[Atom, bool]]]) -> list[tuple[Atom, bool]]:
        return [literal for part in parts for literal in part]

    return fold(formula, lambda atom, state: [(atom, state)], joined, joined, lambda kind, variables, body: body)


def bind(formula: Formula, values: Mapping[str, str]) -> Formula:
    """Returns a formula without quantifiers in negation normal form, with its variables replaced by values."""

    def bound(atom: Atom, state: bool) -> Formula:
        terms = tuple(values.get(t, t) for t in atom.terms)
        if atom.predicate.kind is not Kind.SAME:
            return literal_formula(Atom(atom.predicate, terms), state)
        return same(*terms) if state else negation(same(*terms))

    return fold(formula, bound, conjunction, disjunction)


def expand_quantifiers(formula: Formula, members: Callable[[str], Sequence[str]]) -> Formula:
    """Returns the formula in negation normal form, with its quantifiers expanded.

    :param members: returns the objects of a class.
    :raises WrongValue: the expansion has more than `MAX_INSTANCES` formulas.
    """

    def expanded(kind: type[ForAll | Exists], variables: Variables, body: Formula) -> Formula:
        objects = [members(cls) for _, cls in variables]
        count = prod(map(len, objects))
        if count > MAX_INSTANCES:
            whole = kind(variables, body)
            raise WrongValue(f"{whole} expands to {count} formulas, the limit is {MAX_INSTANCES}")
        names = [variable for variable, _ in variables]
        instances = (bind(body, dict(zip(names, choice, strict=True))) for choice in product(*objects))
        return conjunction(instances) if kind is ForAll else disjunction(instances)

    return fold(formula, literal_formula, conjunction, disjunction, expanded)


def holds(formula: Formula, state: Container[Atom]) -> bool:
    """Whether a ground formula without quantifiers holds in a state, the container of all true atoms."""
    return fold(formula, lambda atom, wanted: (atom in state) == wanted, all, any)
