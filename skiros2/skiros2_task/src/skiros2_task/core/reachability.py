"""Relaxed reachability: the facts that are reachable if a value that a fact once had is never lost.

They are a superset of the facts that any plan reaches, so other facts are unreachable (the delete relaxation: Bonet and
Geffner, Planning as heuristic search, AIJ 2001).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from skiros2_task.core.actions import Action
from skiros2_task.core.formula import Atom, Formula, Predicate, bind, conjuncts, fold
from skiros2_task.core.task import PlanningTask, PlanStep

Binding = dict[str, str]


@dataclass
class Reached:
    """The atoms that may become true, and those that may become false.

    :param complete: False if the deadline passed.
    """

    init: frozenset[Atom]
    true: set[Atom] = field(default_factory=set)
    false: set[Atom] = field(default_factory=set)
    by_predicate: dict[Predicate, dict[tuple[str, ...], None]] = field(default_factory=dict)
    complete: bool = True
    _by_term: dict[tuple[Predicate, int, str], list[tuple[str, ...]]] = field(default_factory=dict)

    def add(self, atom: Atom, state: bool) -> bool:
        """Adds an atom that may become true or false. Returns whether it is new."""
        atoms = self.true if state else self.false
        if atom in atoms:
            return False
        atoms.add(atom)
        if state:
            self.by_predicate.setdefault(atom.predicate, {})[atom.terms] = None
            for position, term in enumerate(atom.terms):
                self._by_term.setdefault((atom.predicate, position, term), []).append(atom.terms)
        return True

    def may_hold(self, formula: Formula) -> bool:
        """Whether a ground formula without quantifiers may become true."""
        return fold(formula, self._may_be, all, any)

    def _may_be(self, atom: Atom, state: bool) -> bool:
        return atom in self.true if state else atom not in self.init or atom in self.false

    def matches(self, atom: Atom, binding: Binding) -> Iterator[Binding]:
        """Yields the completions of a binding for which the atom may become true."""
        pattern = tuple(binding.get(t, t) for t in atom.terms)
        bound = [(atom.predicate, position, term) for position, term in enumerate(pattern) if not term.startswith("?")]
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


class Deadline:
    """A point in time, or an earlier cancellation.

    :param seconds: from now, in wall-clock time.
    """

    def __init__(self, seconds: float, cancelled: threading.Event | None = None) -> None:
        self._end = time.monotonic() + seconds
        self._cancelled = cancelled

    @property
    def has_passed(self) -> bool:
        return time.monotonic() > self._end or (self._cancelled is not None and self._cancelled.is_set())


def explore(task: PlanningTask, deadline: Deadline) -> Reached:
    """Returns the reachable atoms of a task, found before the deadline."""
    reached = Reached(task.init)
    for atom in task.init:
        reached.add(atom, True)
    done: set[PlanStep] = set()
    growing = True
    while growing:
        growing = False
        for action in task.actions:
            for step in steps_of(task, action, reached):
                if deadline.has_passed:
                    reached.complete = False
                    return reached
                if step not in done:
                    done.add(step)
                    for atom, state in task.ground(step).effects.items():
                        growing |= reached.add(atom, state)
    return reached


def steps_of(task: PlanningTask, action: Action, reached: Reached) -> Iterator[PlanStep]:
    """Yields the steps of an action whose pre-condition may become true."""
    for binding in bindings(task, action, conjuncts(action.precondition), reached, {}):
        yield PlanStep(action.name, tuple(binding[v.name] for v in action.variables))


def bindings(
    task: PlanningTask, action: Action, parts: Sequence[Formula], reached: Reached, start: Binding
) -> Iterator[Binding]:
    """Yields the complete bindings of an action's variables for which some conditions may become true.

    :param parts: the conditions.
    :param start: a partial binding.
    """
    atoms = [part for part in parts if isinstance(part, Atom)]
    rest = [part for part in parts if not isinstance(part, Atom)]
    candidates = {v.name: task.candidates(v.classes) for v in action.variables}
    allowed = {name: set(objects) for name, objects in candidates.items()}

    def complete(binding: Binding, todo: list[Atom]) -> Iterator[Binding]:
        if todo:
            # The condition with the fewest unbound variables first, then with the fewest facts.
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
