"""What may come about if nothing that was once true, or once false, were ever undone.

The facts reached so are a superset of those that any plan reaches (the relaxation that planners take their heuristics
from: Bonet and Geffner, Planning as heuristic search, AIJ 2001). What is not among them is unreachable for sure.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
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
    _by_term: dict[tuple[Predicate, int, str], list[tuple[str, ...]]] = field(default_factory=dict)

    def add(self, atom: Atom, state: bool) -> bool:
        """Notes that an atom may become true or false. Whether that is new."""
        there = self.true if state else self.false
        if atom in there:
            return False
        there.add(atom)
        if state:
            self.by_predicate.setdefault(atom.predicate, {})[atom.terms] = None
            for place, term in enumerate(atom.terms):
                self._by_term.setdefault((atom.predicate, place, term), []).append(atom.terms)
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
        bound = [(atom.predicate, place, term) for place, term in enumerate(pattern) if not term.startswith("?")]
        if len(bound) == len(pattern):
            if Atom(atom.predicate, pattern) in self.true:
                yield binding
            return
        facts = self._by_term.get(bound[0], ()) if bound else self.by_predicate.get(atom.predicate, ())
        for terms in list(facts):
            found = dict(binding)
            if all(
                found.setdefault(wanted, term) == term if wanted.startswith("?") else wanted == term
                for wanted, term in zip(pattern, terms, strict=True)
            ):
                yield found


class Patience:
    """How long to look for something.

    :param seconds: of wall time, from now on.
    :param cancelled: ends it before that when it is set.
    """

    def __init__(self, seconds: float, cancelled: threading.Event | None = None) -> None:
        self._ends = time.monotonic() + seconds
        self._cancelled = cancelled

    @property
    def is_over(self) -> bool:
        return time.monotonic() > self._ends or (self._cancelled is not None and self._cancelled.is_set())


def explore(task: PlanningTask, patience: Patience) -> Reached:
    """All that may come about in a task, as far as the patience lasts."""
    reached = Reached(task.init)
    for atom in task.init:
        reached.add(atom, True)
    done: set[PlanStep] = set()
    growing = True
    while growing:
        growing = False
        for action in task.actions:
            for step in steps_of(task, action, reached):
                if patience.is_over:
                    reached.complete = False
                    return reached
                if step not in done:
                    done.add(step)
                    for atom, state in list(effects_of(task, step)):
                        growing |= reached.add(atom, state)
    return reached


def steps_of(task: PlanningTask, action: Action, reached: Reached) -> Iterator[PlanStep]:
    """The ways to do an action when its pre-condition may hold."""
    for binding in ways(task, action, conjuncts(action.precondition), reached, {}):
        yield PlanStep(action.name, tuple(binding[v.name] for v in action.variables))


def ways(
    task: PlanningTask, action: Action, parts: Sequence[Formula], reached: Reached, start: Binding
) -> Iterator[Binding]:
    """The objects for all variables of an action with which some conditions may hold.

    :param parts: the conditions.
    :param start: the objects of those variables that are given.
    """
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

    for binding in complete(start, atoms):
        if all(reached.may_hold(bind(part, binding)) for part in rest):
            yield binding
