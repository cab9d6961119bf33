"""Elements that skills create or remove: adds `IN_SCENE` conditions for elements whose existence can change."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from skiros2_task.core.actions import IN_SCENE, Action, Effect, Variable
from skiros2_task.core.formula import (
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
    conjunction,
    disjunction,
    rewrite,
)
from skiros2_task.core.task import EVERYTHING

IsSubclass = Callable[[str, str], bool]


class Existence:
    """The classes whose elements some skill creates or removes."""

    def __init__(self, actions: Sequence[Action], is_subclass: IsSubclass) -> None:
        self._is_subclass = is_subclass
        self._changing = [
            cls for a in actions for v in a.variables if v.name in a.created | a.removed for cls in v.classes
        ]

    def may_change(self, classes: Iterable[str]) -> bool:
        """Whether an element of these classes may be created or removed."""
        return any(
            self._is_subclass(cls, other) or self._is_subclass(other, cls)
            for cls in classes
            for other in self._changing
        )

    def guard_action(self, action: Action, predicates: Iterable[Predicate]) -> Action:
        """Returns the action with the pre-condition that its elements exist; a removed element loses all its facts.

        :param predicates: of all conditions and the goal.
        """
        if not self._changing:
            return action
        guards = [
            Atom(IN_SCENE, (v.name,))
            for v in action.variables
            if v.name not in action.created and self.may_change(v.classes)
        ]
        lost = [e for term in sorted(action.removed) for e in _losses(term, predicates)]
        return replace(
            action,
            precondition=conjunction([action.precondition, *guards]),
            effects=(*action.effects, *lost),
        )

    def guard_goal(self, goal: Formula) -> Formula:
        """Returns the goal with its quantifiers restricted to existing elements."""
        if isinstance(goal, Atom):
            return goal
        if isinstance(goal, Not):
            return Not(self.guard_goal(goal.part))
        if isinstance(goal, And):
            return conjunction(self.guard_goal(p) for p in goal.parts)
        if isinstance(goal, Or):
            return disjunction(self.guard_goal(p) for p in goal.parts)
        body = self.guard_goal(goal.body)
        guards = [Atom(IN_SCENE, (name,)) for name, cls in goal.variables if self.may_change([cls])]
        if isinstance(goal, ForAll):
            return ForAll(goal.variables, disjunction([*(Not(g) for g in guards), body]))
        return Exists(goal.variables, conjunction([*guards, body]))

    def new_objects(self, actions: Iterable[Action], goal: Formula) -> dict[str, str]:
        """Returns names and classes of objects for elements that skills may create, enough for the goal's `exists`."""
        found: dict[str, str] = {}
        for action in actions:
            for variable in action.variables:
                if variable.name in action.created:
                    cls = self._narrowest(variable)
                    for number in range(1, max(1, _count_exists(goal)) + 1):
                        found[f"new {cls} {number}"] = cls
        return found

    def _narrowest(self, variable: Variable) -> str:
        for cls in variable.classes:
            if all(self._is_subclass(cls, other) for other in variable.classes):
                return cls
        return variable.classes[0]


def without_existence(formula: Formula) -> Formula:
    """Returns the formula simplified for a scene in which all elements exist permanently."""

    def positive(atom: Atom) -> Formula:
        return TRUE if atom.predicate == IN_SCENE else atom

    def negative(atom: Atom) -> Formula:
        return Or(()) if atom.predicate == IN_SCENE else Not(atom)

    return rewrite(formula, positive, negative)


def _losses(term: str, predicates: Iterable[Predicate]) -> list[Effect]:
    """Returns the effects of the removal of an element on its facts."""
    found: dict[Effect, None] = {}
    for predicate in predicates:
        if predicate.kind is Kind.RELATION:
            for terms in ((term, "?other"), ("?other", term)):
                found[Effect(Atom(predicate, terms), False, (("?other", EVERYTHING),))] = None
        elif predicate.kind in (Kind.VALUE, Kind.HAS, Kind.COMPARES):
            found[Effect(Atom(Predicate(Kind.HAS, predicate.name), (term,)), False)] = None
    return list(found)


def _count_exists(goal: Formula) -> int:
    if isinstance(goal, Exists):
        return len(goal.variables) + _count_exists(goal.body)
    if isinstance(goal, ForAll):
        return _count_exists(goal.body)
    if isinstance(goal, Not):
        return _count_exists(goal.part)
    return 0 if isinstance(goal, Atom) else sum(_count_exists(p) for p in goal.parts)
