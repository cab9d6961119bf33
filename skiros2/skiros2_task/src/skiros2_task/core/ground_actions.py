"""Actions prepared for fast simulation: facts as small tuples, and the parameters that the robot determines."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.formula import (
    And,
    Atom,
    Formula,
    Kind,
    Not,
    Or,
    Predicate,
    conjuncts,
    expand_quantifiers,
    literals,
)
from skiros2_task.core.task import PlanningTask

#: A predicate's number and the terms.
Fact = tuple[int | str, ...]
FactLiteral = tuple[Fact, bool]


class Facts:
    """The initial facts, with numbers for predicates."""

    def __init__(self, init: Iterable[Atom]) -> None:
        self._numbers: dict[Predicate, int] = {}
        self.init = frozenset(self.fact(atom) for atom in init)

    def number(self, predicate: Predicate) -> int:
        return self._numbers.setdefault(predicate, len(self._numbers))

    def is_functional(self, number: int, position: int) -> bool:
        """Whether the term at a position of a binary predicate determines the other term."""
        terms = [fact[position + 1] for fact in self.init if fact[0] == number]
        return len(terms) == len(set(terms))

    def fact(self, atom: Atom) -> Fact:
        return (self.number(atom.predicate), *atom.terms)


@dataclass(frozen=True)
class Pattern:
    """An atom over an action's variables: the predicate's number, and indices of variables or names of objects."""

    number: int
    terms: tuple[int | str, ...]

    def fact(self, values: Sequence[str]) -> Fact:
        return (self.number, *(values[t] if isinstance(t, int) else t for t in self.terms))


@dataclass(frozen=True)
class Need:
    """A pre-condition in negation normal form: a literal, a conjunction or a disjunction.

    :param pattern: the literal's atom; None for a conjunction or disjunction.
    :param state: of a literal, whether it is positive; otherwise True for a conjunction.
    """

    pattern: Pattern | None
    state: bool
    parts: tuple[Need, ...] = ()


@dataclass(frozen=True)
class Grounded:
    """A step.

    :param needs: the literals that it needs, of predicates that steps change.
    :param choices: further needs, with alternatives.
    :param changes: its effects; an atom that is made both true and false is true.
    :param during: its effects while it runs.
    """

    values: tuple[str, ...]
    needs: tuple[FactLiteral, ...]
    choices: tuple[Need, ...]
    changes: tuple[FactLiteral, ...]
    during: tuple[FactLiteral, ...]


@dataclass(frozen=True)
class _Change:
    """An effect. `each` has the combinations of values of the effect's own variables."""

    pattern: Pattern
    state: bool
    each: tuple[tuple[str, ...], ...]

    def literals(self, values: tuple[str, ...]) -> Iterator[FactLiteral]:
        for choice in self.each:
            yield self.pattern.fact((*values, *choice) if choice else values), self.state


class GroundAction:
    """An action whose variables are numbers.

    :ivar tools: the variables that the robot determines permanently, such as its gripper, each with the determining
        fact.
    :ivar states: the variables that the robot's state determines, such as its location.
    :ivar determined: tools and states.
    :ivar essential: all other variables but the robot; they define the purpose of a step.
    :ivar is_move: whether the action changes only facts about the robot.
    """

    def __init__(self, action: Action, task: PlanningTask, facts: Facts, changed: Collection[Predicate]) -> None:
        """
        :param changed: the predicates that some action changes.
        """
        self.action = action
        self._index = {v.name: i for i, v in enumerate(action.variables)}
        self._facts = facts
        self.robot = self._index[action.robot]
        needed = expand_quantifiers(action.precondition, task.members.__getitem__)
        needs = [self._need(part, True) for part in conjuncts(needed)]
        numbers = {facts.number(p) for p in changed}
        plain = [(n.pattern, n.state) for n in needs if n.pattern is not None]
        self._fixed = [(pattern, state) for pattern, state in plain if pattern.number not in numbers]
        self._needs = [(pattern, state) for pattern, state in plain if pattern.number in numbers]
        self._choices = tuple(n for n in needs if n.pattern is None)
        self._effects = tuple(self._change(e, task) for e in action.effects)
        self._during = tuple(self._change(e, task) for e in action.during)
        self._members = [set.intersection(*(set(task.members[c]) for c in v.classes)) for v in action.variables]
        self._grounded: dict[tuple[str, ...], Grounded | None] = {}
        with_robot = [
            part
            for part in conjuncts(needed)
            if isinstance(part, Atom) and len(part.terms) == 2 and action.robot in part.terms
        ]
        static = self._bound([a for a in with_robot if a.predicate not in changed])
        self.tools = {i: p for i, p in static.items() if facts.is_functional(p.number, p.terms.index(i))}
        own = {action.robot, *(action.variables[i].name for i in self.tools)}
        bound = self._bound([a for a in with_robot if a.predicate in changed])
        self.is_move = all(action.robot in e.atom.terms and not e.each for e in (*action.effects, *action.during))
        # Static facts may relate the start of a move to its end, but make the location of other actions essential.
        named = [
            a for a, _ in literals(needed) if len(a.terms) > 1 and not (self.is_move and a.predicate not in changed)
        ]
        named += [e.atom for e in (*action.effects, *action.during)]
        self.states = {
            i: pattern
            for i, pattern in bound.items()
            if i not in self.tools and _occurs_only_with(own, action.variables[i].name, named)
        }
        self.determined = [*self.tools.items(), *self.states.items()]
        self.essential = [i for i in range(len(action.variables)) if i not in (self.robot, *self.tools, *self.states)]

    def can(self, robot: str, init: Collection[Atom]) -> bool:
        """Whether a robot has the skill."""
        return Atom(Predicate(Kind.CAN, self.action.name), (robot,)) in init

    def grounded(self, values: tuple[str, ...]) -> Grounded | None:
        """Returns the step with these values; None if it is never applicable."""
        if values not in self._grounded:
            self._grounded[values] = self._ground(values)
        return self._grounded[values]

    def _ground(self, values: tuple[str, ...]) -> Grounded | None:
        if any(value not in members for value, members in zip(values, self._members, strict=True)):
            return None
        if any((pattern.fact(values) in self._facts.init) != state for pattern, state in self._fixed):
            return None
        changes: dict[Fact, bool] = {}
        for change in self._effects:
            for fact, state in change.literals(values):
                changes[fact] = state or changes.get(fact, False)
        return Grounded(
            values,
            tuple((pattern.fact(values), state) for pattern, state in self._needs),
            self._choices,
            tuple(changes.items()),
            tuple(literal for change in self._during for literal in change.literals(values)),
        )

    def _bound(self, atoms: Sequence[Atom]) -> dict[int, Pattern]:
        """Returns the variables of atoms other than the robot, each with its first atom."""
        found: dict[int, Pattern] = {}
        for atom in atoms:
            pattern = self._pattern(atom)
            for term in pattern.terms:
                if isinstance(term, int) and term != self.robot:
                    found.setdefault(term, pattern)
        return found

    def _pattern(self, atom: Atom, more: Mapping[str, int] | None = None) -> Pattern:
        index = {**self._index, **(more or {})}
        return Pattern(self._facts.number(atom.predicate), tuple(index.get(t, t) for t in atom.terms))

    def _need(self, formula: Formula, wanted: bool) -> Need:
        if isinstance(formula, Atom):
            return Need(self._pattern(formula), wanted)
        if isinstance(formula, Not):
            return self._need(formula.part, not wanted)
        if not isinstance(formula, And | Or):
            raise TypeError(f"{formula} has a quantifier; expand it first")
        return Need(None, isinstance(formula, And) == wanted, tuple(self._need(p, wanted) for p in formula.parts))

    def _change(self, effect: Effect, task: PlanningTask) -> _Change:
        more = {name: len(self._index) + i for i, (name, _) in enumerate(effect.each)}
        each = tuple(product(*(task.members[cls] for _, cls in effect.each)))
        return _Change(self._pattern(effect.atom, more), effect.state, each)


def _occurs_only_with(own: Collection[str], name: str, atoms: Iterable[Atom]) -> bool:
    """Whether every atom with a variable also has the robot or one of its tools."""
    return all(any(t in own for t in a.terms) for a in atoms if name in a.terms)


def ground_actions(task: PlanningTask, facts: Facts) -> dict[str, GroundAction]:
    """Returns the actions of a task, by name.

    :param facts: of the task.
    """
    changed = {e.atom.predicate for a in task.actions for e in (*a.effects, *a.during)}
    return {a.name: GroundAction(a, task, facts, changed) for a in task.actions}
