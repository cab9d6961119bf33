"""Which facts can never hold at the same time.

Pairs of facts that some sequence of steps may bring about together are collected from the start on; a step leads on
from a pair where all that it needs, and what is to stay, may hold together pairwise. What is not among them is excluded
for sure (the heuristic h2: Haslum and Geffner, Admissible heuristics for optimal planning, AIPS 2000).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement

from skiros2_task.core.formula import Atom, conjuncts
from skiros2_task.core.reachability import Patience, Reached, steps_of
from skiros2_task.core.task import PlanningTask, PlanStep, effects_of, precondition_of


@dataclass(frozen=True)
class _Step:
    """A step, over the numbers of facts.

    :param deleted: the facts that it makes false, as bits; none of them is added.
    """

    step: PlanStep
    needed: tuple[int, ...]
    added: tuple[int, ...]
    deleted: int


class Exclusion:
    """The pairs of facts of a task that may hold together. Sets of facts are the bits of an int."""

    def __init__(self, task: PlanningTask, reached: Reached) -> None:
        self._numbers = {atom: number for number, atom in enumerate(reached.true)}
        self._steps: list[_Step] = []
        self._with = [0] * len(self._numbers)  # for each fact those that may hold together with it, and itself
        start = sum(1 << self._numbers[atom] for atom in task.init)
        for atom in task.init:
            self._with[self._numbers[atom]] = start

    def excluded(self, one: Atom, other: Atom) -> bool:
        """Whether two facts can never hold together; with one fact for both, whether it never can."""
        numbers = self._numbers
        if one not in numbers or other not in numbers:
            return True
        return not self._with[numbers[one]] >> numbers[other] & 1

    def obstacle(self, atom: Atom) -> tuple[PlanStep, Atom, Atom]:
        """For a fact that can never hold: a step that would bring it about, with two facts that it needs together.

        The step that needs the least is taken, as a guess at the plainest.
        """
        facts = list(self._numbers)
        adding = [step for step in self._steps if self._numbers[atom] in step.added]
        for step in sorted(adding, key=lambda step: len(step.needed)):
            for one, other in combinations_with_replacement(step.needed, 2):
                if not self._with[one] >> other & 1:
                    return step.step, facts[one], facts[other]
        raise LookupError(f"{atom} may hold")

    def add(self, task: PlanningTask, step: PlanStep) -> None:
        """One more step that may be done. Of what it needs the facts that have to hold count, not alternatives."""
        parts = conjuncts(precondition_of(task, step))
        needed = tuple(self._numbers[part] for part in parts if isinstance(part, Atom))
        changes = list(effects_of(task, step))
        added = {self._numbers[atom] for atom, state in changes if state}
        gone = {self._numbers[atom] for atom, state in changes if not state and atom in self._numbers} - added
        self._steps.append(_Step(step, needed, tuple(sorted(added)), sum(1 << fact for fact in gone)))

    def grow(self, patience: Patience) -> bool:
        """Takes note of all that the steps lead to. Whether there was time for it."""
        growing = True
        while growing:
            growing = False
            for step in self._steps:
                if patience.is_over:
                    return False
                growing |= self._grow(step)
        return True

    def _grow(self, step: _Step) -> bool:
        if step.needed:
            stay = -1
            for fact in step.needed:
                stay &= self._with[fact]
            if any(not stay >> fact & 1 for fact in step.needed):
                return False
        else:
            stay = sum(1 << fact for fact, others in enumerate(self._with) if others)
        after = (stay & ~step.deleted) | sum(1 << fact for fact in step.added)
        is_new = False
        for fact in step.added:
            new = after & ~self._with[fact]
            if new:
                is_new = True
                self._with[fact] |= new
                for other in _bits(new):
                    self._with[other] |= 1 << fact
        return is_new


def exclusion(task: PlanningTask, reached: Reached, patience: Patience) -> Exclusion | None:
    """Which facts of a task exclude each other; None when there was no time to find out.

    :param reached: all that may come about, as `explore` finds it.
    """
    if not reached.complete:
        return None
    found = Exclusion(task, reached)
    for action in task.actions:
        for step in steps_of(task, action, reached):
            if patience.is_over:
                return None
            found.add(task, step)
    return found if found.grow(patience) else None


def _bits(number: int) -> Iterator[int]:
    while number:
        lowest = number & -number
        yield lowest.bit_length() - 1
        number ^= lowest
