"""Detects problems with required concurrency.

Planners produce sequences; `partial_order` finds afterwards which steps may overlap. A sequence is sufficient unless a
fact is needed that holds only while another step runs (Cushing, Kambhampati, Mausam, Weld: When is temporal planning
really temporal?, IJCAI 2007). A skill declares such a fact by a hold-condition that contradicts its pre-condition.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product

from skiros2_task.core.actions import Action
from skiros2_task.core.effects import FactFamilies, Literal
from skiros2_task.core.formula import Atom, Formula, expand_quantifiers, literals
from skiros2_task.core.task import PlanningTask


def needs_concurrency(task: PlanningTask, actions: Iterable[Action], families: FactFamilies) -> tuple[str, ...]:
    """Returns a message for each needed fact that holds only while a skill runs; () if a sequence of steps suffices.

    :param actions: all actions, also those that the task excludes.
    """
    permanent = {(e.atom.predicate, e.state) for a in task.actions for e in a.effects}
    temporary: dict[Literal, str] = {}
    for action in actions:
        for effect in action.during:
            for literal in families.consequences(effect.atom.predicate, effect.state, task.predicates):
                if literal not in permanent:
                    temporary.setdefault(literal, action.skill.name)
    found: dict[str, None] = {}
    for owner, formula, classes in _needs(task) if temporary else ():
        for atom, state in literals(formula):
            skill = temporary.get((atom.predicate, state))
            if skill is not None and not _may_hold(atom, state, classes, task):
                fact = str(atom.predicate) if state else f"not {atom.predicate}"
                found[f"{owner} needs a fact that holds only while skill {skill} runs: {fact}"] = None
    return tuple(found)


def _needs(task: PlanningTask) -> Iterator[tuple[str, Formula, dict[str, tuple[str, ...]]]]:
    """Yields the goal and the pre-conditions, each with its owner and the classes of its variables."""
    yield "the goal", task.goal, {}
    for action in task.actions:
        needed = expand_quantifiers(action.precondition, task.members.__getitem__)
        yield f"skill {action.skill.name}", needed, {v.name: v.classes for v in action.variables}


def _may_hold(atom: Atom, state: bool, classes: dict[str, tuple[str, ...]], task: PlanningTask) -> bool:
    """Whether an atom has a value initially, for some objects."""
    choices = (task.candidates(classes[t]) if t in classes else [t] for t in atom.terms)
    return any((Atom(atom.predicate, terms) in task.init) == state for terms in product(*choices))
