"""Mutex facts: pairs of facts that can never hold at the same time.

Collects, from the initial facts on, the pairs that some sequence of steps may reach: a step preserves a pair, or adds
to it, if its pre-conditions are pairwise reachable together with the preserved fact. All other pairs are mutex (the
heuristic h2: Haslum and Geffner, Admissible heuristics for optimal planning, AIPS 2000).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement

from skiros2_task.core.formula import Atom, conjuncts
from skiros2_task.core.reachability import Deadline, Reached, steps_of
from skiros2_task.core.task import PlanningTask, PlanStep, effects_of, precondition_of


@dataclass(frozen=True)
class _Step:
    """A step over numbered facts.

    :param deleted: a bit set, disjoint from `added`.
    """

    step: PlanStep
    needed: tuple[int, ...]
    added: tuple[int, ...]
    deleted: int


class Mutexes:
    """The mutex pairs of facts of a task. Sets of facts are bit sets."""

    def __init__(self, task: PlanningTask, reached: Reached) -> None:
        self._numbers = {atom: number for number, atom in enumerate(reached.true)}
        self._steps: list[_Step] = []
        self._with = [0] * len(self._numbers)  # for each fact, the facts that may hold with it, including itself
        start = sum(1 << self._numbers[atom] for atom in task.init)
        for atom in task.init:
            self._with[self._numbers[atom]] = start

    def are_mutex(self, one: Atom, other: Atom) -> bool:
        """Whether two facts can never hold together; for equal facts, whether the fact can never hold."""
        numbers = self._numbers
        if one not in numbers or other not in numbers:
            return True
        return not self._with[numbers[one]] >> numbers[other] & 1

    def obstacle(self, atom: Atom) -> tuple[PlanStep, Atom, Atom]:
        """For a fact that can never hold: returns a step with this effect, and two mutex facts that the step needs.

        Of several steps, returns the one with the fewest needs, as the easiest to understand.
        """
        facts = list(self._numbers)
        adding = [step for step in self._steps if self._numbers[atom] in step.added]
        for step in sorted(adding, key=lambda step: len(step.needed)):
            for one, other in combinations_with_replacement(step.needed, 2):
                if not self._with[one] >> other & 1:
                    return step.step, facts[one], facts[other]
        raise LookupError(f"{atom} may hold")

    def add(self, task: PlanningTask, step: PlanStep) -> None:
        """Adds a step. Only positive literals of its pre-condition are considered."""
        parts = conjuncts(precondition_of(task, step))
        needed = tuple(self._numbers[part] for part in parts if isinstance(part, Atom))
        changes = list(effects_of(task, step))
        added = {self._numbers[atom] for atom, state in changes if state}
        gone = {self._numbers[atom] for atom, state in changes if not state and atom in self._numbers} - added
        self._steps.append(_Step(step, needed, tuple(sorted(added)), sum(1 << fact for fact in gone)))

    def propagate(self, deadline: Deadline) -> bool:
        """Applies all steps until no pair is new. Returns False if the deadline passes."""
        growing = True
        while growing:
            growing = False
            for step in self._steps:
                if deadline.has_passed:
                    return False
                growing |= self._apply(step)
        return True

    def _apply(self, step: _Step) -> bool:
        if step.needed:
            preserved = -1
            for fact in step.needed:
                preserved &= self._with[fact]
            if any(not preserved >> fact & 1 for fact in step.needed):
                return False
        else:
            preserved = sum(1 << fact for fact, others in enumerate(self._with) if others)
        after = (preserved & ~step.deleted) | sum(1 << fact for fact in step.added)
        is_new = False
        for fact in step.added:
            new = after & ~self._with[fact]
            if new:
                is_new = True
                self._with[fact] |= new
                for other in _bits(new):
                    self._with[other] |= 1 << fact
        return is_new


def find_mutexes(task: PlanningTask, reached: Reached, deadline: Deadline) -> Mutexes | None:
    """Returns the mutex facts of a task; None if the deadline passes.

    :param reached: the result of `explore`.
    """
    if not reached.complete:
        return None
    found = Mutexes(task, reached)
    for action in task.actions:
        for step in steps_of(task, action, reached):
            if deadline.has_passed:
                return None
            found.add(task, step)
    return found if found.propagate(deadline) else None


def _bits(number: int) -> Iterator[int]:
    while number:
        lowest = number & -number
        yield lowest.bit_length() - 1
        number ^= lowest
