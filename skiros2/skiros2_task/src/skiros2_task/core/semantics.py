"""The semantics of steps: what a step needs, and what it changes.

The only implementation. Validation, ordering, scheduling, execution, explanations and the search for reachable facts
use it.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.formula import (
    Atom,
    Formula,
    Not,
    Predicate,
    bind,
    conjunction,
    conjuncts,
    expand_quantifiers,
    fold,
    holds,
    literal_formula,
    literals,
)

Facts = frozenset[Atom]
#: An atom, and whether it is true.
Literal = tuple[Atom, bool]


@dataclass(frozen=True)
class GroundStep:
    """The conditions and effects of a step.

    :param robot: the object that executes it.
    :param needs: the literals that must hold from its start to its end.
    :param choices: further conditions, with alternatives.
    :param effects: the values of facts at its end. An atom that is made both true and false is true, as in PDDL.
    :param during: the values of facts while it runs; they are restored at its end.
    """

    robot: str
    needs: tuple[Literal, ...]
    choices: tuple[Formula, ...]
    effects: Mapping[Atom, bool]
    during: Mapping[Atom, bool]

    @cached_property
    def precondition(self) -> Formula:
        """The condition that must hold from the start of the step to its end."""
        return conjunction([*(literal_formula(*literal) for literal in self.needs), *self.choices])

    @property
    def changes(self) -> tuple[Literal, ...]:
        """The literals that the step makes true, by its end or while it runs."""
        return (*self.effects.items(), *self.during.items())

    @cached_property
    def needed_atoms(self) -> frozenset[Atom]:
        """The atoms of all conditions."""
        return frozenset(atom for atom, _ in (*self.needs, *(lit for c in self.choices for lit in literals(c))))

    def can_start(self, facts: Container[Atom]) -> bool:
        """Whether all conditions hold."""
        return all((atom in facts) == state for atom, state in self.needs) and all(
            holds(choice, facts) for choice in self.choices
        )

    def apply(self, facts: Facts) -> Facts:
        """Returns the facts after the step."""
        return apply(facts, self.effects)


def apply(facts: Facts, effects: Mapping[Atom, bool]) -> Facts:
    """Returns the facts after some effects."""
    return (facts - effects.keys()) | {atom for atom, value in effects.items() if value}


@dataclass(frozen=True)
class _Pattern:
    """An atom over an action's variables. A term is an index of a value, or the name of an object."""

    predicate: Predicate
    terms: tuple[int | str, ...]
    state: bool
    #: Of an effect for all values of own variables: the combinations of these values.
    each: tuple[tuple[str, ...], ...] = ((),)

    def atom(self, values: Sequence[str]) -> Atom:
        return Atom(self.predicate, tuple([t if isinstance(t, str) else values[t] for t in self.terms]))

    def atoms(self, values: tuple[str, ...]) -> list[Atom]:
        return [self.atom((*values, *choice) if choice else values) for choice in self.each]


class Grounder:
    """Computes what the steps of one action need and change."""

    def __init__(self, action: Action, members: Mapping[str, tuple[str, ...]]) -> None:
        """
        :param members: the objects of each class.
        """
        self.action = action
        self._members = members
        self._names = [variable.name for variable in action.variables]
        self._robot = self._names.index(action.robot)
        #: The parts of the pre-condition, over the action's variables.
        self.conditions = conjuncts(expand_quantifiers(action.precondition, members.__getitem__))
        self._needs: list[_Pattern] = []
        self._choices: list[Formula] = []
        for part in self.conditions:
            atom = part.part if isinstance(part, Not) else part
            if isinstance(atom, Atom):
                self._needs.append(self._pattern(atom, atom is part))
            else:
                self._choices.append(part)
        self._effects = [self._change(effect) for effect in action.effects]
        self._during = [self._change(effect) for effect in action.during]

    @cached_property
    def objects(self) -> list[set[str]]:
        """The possible values of each variable."""
        return [set.intersection(*(set(self._members[c]) for c in v.classes)) for v in self.action.variables]

    def ground(self, arguments: tuple[str, ...]) -> GroundStep:
        """Returns the step with a value for each variable."""
        effects: dict[Atom, bool] = {}
        for change in self._effects:
            for atom in change.atoms(arguments):
                effects[atom] = change.state or effects.get(atom, False)
        values = dict(zip(self._names, arguments, strict=True))
        return GroundStep(
            arguments[self._robot],
            tuple([(need.atom(arguments), need.state) for need in self._needs]),
            tuple([bind(choice, values) for choice in self._choices]),
            effects,
            {atom: change.state for change in self._during for atom in change.atoms(arguments)},
        )

    def _change(self, effect: Effect) -> _Pattern:
        each = tuple(product(*(self._members[cls] for _, cls in effect.each)))
        return self._pattern(effect.atom, effect.state, [name for name, _ in effect.each], each)

    def _pattern(
        self, atom: Atom, state: bool, more: Sequence[str] = (), each: tuple[tuple[str, ...], ...] = ((),)
    ) -> _Pattern:
        index = {name: i for i, name in enumerate((*self._names, *more))}
        return _Pattern(atom.predicate, tuple(index.get(t, t) for t in atom.terms), state, each)


def unsatisfied(
    formula: Formula, facts: Container[Atom], most: int | None = None, text_of: Callable[[Formula], str] = str
) -> str:
    """Returns the parts of a formula that do not hold, as text; "" if the formula holds.

    :param most: the largest number of parts in the text.
    :param text_of: formats a part.
    """
    missing = [text_of(part) for part in conjuncts(formula) if not holds(part, facts)]
    more = f" and {len(missing) - most} more" if most is not None and len(missing) > most else ""
    return ", ".join(missing[:most]) + more


def support(formula: Formula, is_true: Callable[[Atom], bool], since: Callable[[Atom], float]) -> list[Literal] | None:
    """Returns literals that make a formula true; None if it is false.

    :param is_true: whether an atom is true.
    :param since: how long an atom has had its value. Of several alternatives, the one that has held longest is taken:
        it constrains a step least.
    """

    def literal(atom: Atom, state: bool) -> list[Literal] | None:
        return [(atom, state)] if is_true(atom) == state else None

    def every(parts: Iterable[list[Literal] | None]) -> list[Literal] | None:
        found: list[Literal] = []
        for part in parts:
            if part is None:
                return None
            found += part
        return found

    def some(parts: Iterable[list[Literal] | None]) -> list[Literal] | None:
        found = [part for part in parts if part is not None]
        return min(found, key=lambda part: max((since(atom) for atom, _ in part), default=-1.0), default=None)

    return fold(formula, literal, every, some)
