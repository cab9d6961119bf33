"""Why there is no plan: what cannot come about even if nothing that was once true, or once false, were ever undone.

The facts reached so are a superset of those that any plan reaches (the relaxation that planners take their heuristics
from: Bonet and Geffner, Planning as heuristic search, AIJ 2001). What is not among them is unreachable for sure.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from skiros2_task.core.actions import Action
from skiros2_task.core.formula import And, Atom, Formula, Not, Predicate, bind, conjuncts
from skiros2_task.core.task import PlanningTask, PlanStep, effects_of

Binding = dict[str, str]


@dataclass
class Reached:
    """What may become true, and what may become false.

    :param complete: all was found; otherwise the time ran out.
    """

    init: frozenset[Atom]
    true: set[Atom] = field(default_factory=set)
    false: set[Atom] = field(default_factory=set)
    by_predicate: dict[Predicate, dict[tuple[str, ...], None]] = field(default_factory=dict)
    complete: bool = True

    def add(self, atom: Atom, state: bool) -> bool:
        """Notes that an atom may become true or false. Whether that is new."""
        there = self.true if state else self.false
        if atom in there:
            return False
        there.add(atom)
        if state:
            self.by_predicate.setdefault(atom.predicate, {})[atom.terms] = None
        return True

    def may_hold(self, formula: Formula) -> bool:
        """Whether a formula in negation normal form, without variables, may come to hold."""
        if isinstance(formula, Atom):
            return formula in self.true
        if isinstance(formula, Not):
            assert isinstance(formula.part, Atom)
            return formula.part not in self.init or formula.part in self.false
        assert not hasattr(formula, "variables")
        every = isinstance(formula, And)
        return (all if every else any)(self.may_hold(part) for part in formula.parts)

    def matches(self, atom: Atom, binding: Binding) -> Iterator[Binding]:
        """The ways to complete a binding so that the atom may become true."""
        pattern = tuple(binding.get(t, t) for t in atom.terms)
        if not any(t.startswith("?") for t in pattern):
            if Atom(atom.predicate, pattern) in self.true:
                yield binding
            return
        for terms in list(self.by_predicate.get(atom.predicate, ())):
            found = dict(binding)
            if all(
                found.setdefault(wanted, term) == term if wanted.startswith("?") else wanted == term
                for wanted, term in zip(pattern, terms, strict=True)
            ):
                yield found


def explore(task: PlanningTask, seconds: float) -> Reached:
    """All that may come about in a task, as far as the time lasts."""
    ends = time.monotonic() + seconds
    reached = Reached(task.init)
    for atom in task.init:
        reached.add(atom, True)
    done: set[PlanStep] = set()
    growing = True
    while growing:
        growing = False
        for action in task.actions:
            for step in _steps(task, action, reached):
                if time.monotonic() > ends:
                    reached.complete = False
                    return reached
                if step not in done:
                    done.add(step)
                    for atom, state in list(effects_of(task, step)):
                        growing |= reached.add(atom, state)
    return reached


def _steps(task: PlanningTask, action: Action, reached: Reached) -> Iterator[PlanStep]:
    """The ways to do an action when its pre-condition may hold."""
    parts = conjuncts(action.precondition)
    atoms = [part for part in parts if isinstance(part, Atom)]
    rest = [part for part in parts if not isinstance(part, Atom)]
    candidates = {v.name: task.candidates(v.classes) for v in action.variables}
    allowed = {name: set(objects) for name, objects in candidates.items()}

    def complete(binding: Binding, todo: list[Atom]) -> Iterator[Binding]:
        if todo:
            # The most bound condition first, of those the one with the fewest facts.
            best = min(
                todo,
                key=lambda a: (
                    sum(t.startswith("?") and t not in binding for t in a.terms),
                    len(reached.by_predicate.get(a.predicate, ())),
                ),
            )
            others = [a for a in todo if a is not best]
            for found in reached.matches(best, binding):
                if all(value in allowed[name] for name, value in found.items() if name not in binding):
                    yield from complete(found, others)
            return
        free = next((v.name for v in action.variables if v.name not in binding), None)
        if free is None:
            yield binding
            return
        for value in candidates[free]:
            yield from complete({**binding, free: value}, [])

    for binding in complete({}, atoms):
        if all(reached.may_hold(bind(part, binding)) for part in rest):
            yield PlanStep(action.name, tuple(binding[v.name] for v in action.variables))


def explain(task: PlanningTask, seconds: float = 5.0) -> list[str] | None:
    """In words, which parts of the goal cannot be reached and what stands in the way; None when time ran out.

    None of them: each can be reached on its own, as far as this tells.
    """
    reached = explore(task, seconds)
    if not reached.complete:
        return None
    return [
        f"{part} cannot be reached: {_obstacle(part, task, reached)}"
        for part in conjuncts(task.goal)
        if not reached.may_hold(part)
    ]


def contradictions(goal: Formula) -> list[str]:
    """In words, what a goal asks for together with its opposite."""
    parts = set(conjuncts(goal))
    return [f"the goal asks for {part} and for the opposite" for part in conjuncts(goal) if Not(part) in parts]


def _obstacle(part: Formula, task: PlanningTask, reached: Reached) -> str:
    """What the skills that could bring about a part of the goal lack."""
    state = not isinstance(part, Not)
    atom = part.part if isinstance(part, Not) else part
    if not isinstance(atom, Atom):
        return "none of its alternatives can"
    hindered = []
    for action in task.actions:
        for effect in action.effects:
            binding = _unify(effect.atom, atom) if effect.state == state else None
            if binding is None:
                continue
            wrong = [
                f"{binding[v.name]} is no {' and '.join(v.classes)}"
                for v in action.variables
                if v.name in binding and binding[v.name] not in task.candidates(v.classes)
            ]
            needs = [bind(p, binding) for p in conjuncts(action.precondition) if isinstance(p, Atom)]
            lacks = [str(need) for need in needs if isinstance(need, Atom) and not any(reached.matches(need, {}))]
            missing = f"it needs {', '.join(lacks)}" if lacks else "its conditions never hold together"
            reason = ", ".join(wrong) or missing
            hindered.append(f"{action.skill.name} cannot bring it about: {reason}")
    return "; ".join(dict.fromkeys(hindered)) or "no skill brings it about"


def _unify(effect: Atom, wanted: Atom) -> Binding | None:
    """The variables' values with which an effect is the wanted atom."""
    if effect.predicate != wanted.predicate:
        return None
    binding: Binding = {}
    for mine, term in zip(effect.terms, wanted.terms, strict=True):
        if (binding.setdefault(mine, term) if mine.startswith("?") else mine) != term:
            return None
    return binding
