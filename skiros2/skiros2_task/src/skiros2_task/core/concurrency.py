"""Whether a problem needs steps that run at the same time.

Planning puts whole steps one after the other; what may overlap is found afterwards (`partial_order`). That is no loss
unless something is needed that holds only while another step runs, and is gone when it ends: then a plan has to start
the one step during the other (Cushing, Kambhampati, Mausam, Weld: When is temporal planning really temporal?, IJCAI
2007). Skills say so with a hold-condition that contradicts their pre-condition: they bring it about themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product

from skiros2_task.core.actions import Action
from skiros2_task.core.effects import FactFamilies, Literal
from skiros2_task.core.formula import Atom, Formula, expand_quantifiers, literals
from skiros2_task.core.task import PlanningTask


def needs_concurrency(task: PlanningTask, actions: Iterable[Action], families: FactFamilies) -> tuple[str, ...]:
    """In words, what is needed though it holds only while a skill runs; () for a problem that steps one after the
    other can solve as well.

    :param actions: all, also those that the task leaves out.
    """
    lasting = {(e.atom.predicate, e.state) for a in task.actions for e in a.effects}
    brief: dict[Literal, str] = {}
    for action in actions:
        for effect in action.during:
            for literal in families.consequences(effect.atom.predicate, effect.state, task.predicates):
                if literal not in lasting:
                    brief.setdefault(literal, action.skill.name)
    found: dict[str, None] = {}
    for who, formula, classes in _needs(task) if brief else ():
        for atom, state in literals(formula):
            skill = brief.get((atom.predicate, state))
            if skill is not None and not _may_hold(atom, state, classes, task):
                fact = str(atom.predicate) if state else f"not {atom.predicate}"
                found[f"{who} needs what holds only while skill {skill} runs: {fact}"] = None
    return tuple(found)


def _needs(task: PlanningTask) -> Iterator[tuple[str, Formula, dict[str, tuple[str, ...]]]]:
    """Who needs what, with the classes of the variables."""
    yield "the goal", task.goal, {}
    for action in task.actions:
        needed = expand_quantifiers(action.precondition, task.members.__getitem__)
        yield f"skill {action.skill.name}", needed, {v.name: v.classes for v in action.variables}


def _may_hold(atom: Atom, state: bool, classes: dict[str, tuple[str, ...]], task: PlanningTask) -> bool:
    """Whether an atom is so at the start, for some objects."""
    choices = (task.candidates(classes[t]) if t in classes else [t] for t in atom.terms)
    return any((Atom(atom.predicate, terms) in task.init) == state for terms in product(*choices))
