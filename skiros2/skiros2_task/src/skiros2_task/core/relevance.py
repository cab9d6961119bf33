"""Which skills and predicates can matter for a goal.

Backwards from the goal: a skill matters when one of its effects makes true something that the goal or the
pre-condition of a skill that matters asks for. What is left out cannot be part of any plan without superfluous steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from skiros2_task.core.actions import Action, Effect
from skiros2_task.core.effects import FactFamilies, Literal
from skiros2_task.core.formula import Atom, Formula, Predicate, literals, rewrite


@dataclass(frozen=True)
class Relevant:
    """The part of a domain that a goal needs.

    :param actions: those that matter, with pre-conditions in negation normal form and effects on `predicates` only.
    :param goal: the goal in negation normal form.
    :param predicates: all that pre-conditions and the goal ask for, in a stable order.
    :param left_out: the names of the actions that do not matter.
    """

    actions: tuple[Action, ...]
    goal: Formula
    predicates: tuple[Predicate, ...]
    left_out: tuple[str, ...]


def relevant_part(actions: Sequence[Action], goal: Formula, families: FactFamilies) -> Relevant:
    """What matters of some actions for a goal."""
    normal = [replace(a, precondition=rewrite(a.precondition, families.positive, families.negative)) for a in actions]
    goal = rewrite(goal, families.positive, families.negative)
    needed: dict[Literal, None] = {}
    _need(goal, needed)
    chosen: set[str] = set()
    growing = True
    while growing:
        growing = False
        for action in normal:
            if action.name not in chosen and _gives(action, needed, families):
                chosen.add(action.name)
                _need(action.precondition, needed)
                growing = True
    predicates = tuple(dict.fromkeys(predicate for predicate, _ in needed))
    kept = tuple(
        replace(
            a,
            effects=_consequences(a.effects, predicates, families),
            during=_consequences(a.during, predicates, families),
        )
        for a in normal
        if a.name in chosen
    )
    return Relevant(kept, goal, predicates, tuple(a.name for a in actions if a.name not in chosen))


def _need(formula: Formula, needed: dict[Literal, None]) -> None:
    for atom, state in literals(formula):
        needed[(atom.predicate, state)] = None


def _gives(action: Action, needed: dict[Literal, None], families: FactFamilies) -> bool:
    predicates = {predicate for predicate, _ in needed}
    return any(
        literal in needed
        for effect in action.effects
        for literal in families.consequences(effect.atom.predicate, effect.state, predicates)
    )


def _consequences(
    effects: Sequence[Effect], predicates: Sequence[Predicate], families: FactFamilies
) -> tuple[Effect, ...]:
    """What effects do to the predicates that matter.

    Where one fact is made both true and false, true wins, as in PDDL.
    """
    found: dict[tuple[Atom, tuple[tuple[str, str], ...]], bool] = {}
    for effect in effects:
        for predicate, state in families.consequences(effect.atom.predicate, effect.state, predicates):
            key = (Atom(predicate, effect.atom.terms), effect.each)
            found[key] = state or found.get(key, False)
    return tuple(Effect(atom, state, each) for (atom, each), state in found.items())
