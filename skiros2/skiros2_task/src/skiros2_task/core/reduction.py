"""Removes redundant steps from a plan.

Action elimination: each step in turn is removed, and with it every later step whose pre-condition then fails, if the
goal still holds at the end (Nakhost and Müller: Action elimination and plan neighborhood graph search, ICAPS 2010;
Fink and Yang: Formalizing plan justifications, CSCSI 1992, who call the result *greedily justified*). This is repeated
until no step can be removed.

A trial visits only the steps that need or change a fact with a different value than in the plan.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from heapq import heappop, heappush

from skiros2_task.core.formula import Atom, Formula, Not, conjuncts, holds, literals
from skiros2_task.core.task import PlanningTask, PlanStep


def reduced(task: PlanningTask, plan: Sequence[PlanStep]) -> tuple[PlanStep, ...]:
    """Returns the plan without redundant steps, in the same order.

    :param plan: a valid plan; see `semantics.validate`.
    :returns: a valid plan from which no step can be removed, alone or with the later steps that need it.
    """
    trials = _Trials(task, plan)
    kept = list(range(len(plan)))
    position = necessary = 0  # necessary: the number of consecutive steps that cannot be removed
    while necessary < len(kept):
        position %= len(kept)
        removed = trials.without(kept[position])
        if removed:
            trials.remove(removed)
            kept = [step for step in kept if step not in removed]
            necessary = 0
        else:
            position += 1
            necessary += 1
    return tuple(plan[step] for step in kept)


class _Trials:
    """Simulates a plan without some of its steps. Steps are indices in the original plan."""

    def __init__(self, task: PlanningTask, plan: Sequence[PlanStep]) -> None:
        self._init = task.init
        self._steps = [task.ground(step) for step in plan]
        self._needed = [step.needed_atoms for step in self._steps]
        self._effects = [step.effects for step in self._steps]
        #: For each atom the steps that make it true or false, and those that need or change it, in order.
        self._producers: dict[Atom, list[tuple[int, bool]]] = {}
        self._users: dict[Atom, list[int]] = {}
        for step in range(len(plan)):
            for atom in self._atoms_of(step):
                self._users.setdefault(atom, []).append(step)
            for atom, state in self._effects[step].items():
                self._producers.setdefault(atom, []).append((step, state))
        #: The goal: atoms whose value must be the same at the end, and formulas with alternatives.
        parts = conjuncts(task.goal)
        self._goal_atoms = {atom for part in parts if _is_literal(part) for atom in _atoms(part)}
        self._alternatives = [(part, _atoms(part)) for part in parts if not _is_literal(part)]

    def without(self, removed: int) -> set[int]:
        """Returns a step and the later steps that need it; the empty set if the goal needs them."""
        gone: set[int] = set()
        different: dict[Atom, bool] = {}  # the current values that differ from those in the plan
        queue, queued = [removed], {removed}
        while queue:
            step = heappop(queue)
            atoms = self._atoms_of(step)
            if step == removed or not self._can_run(step, different):
                gone.add(step)
                for atom, state in self._effects[step].items():
                    now = different.pop(atom, self.value(atom, step))
                    if now != state:
                        different[atom] = now
            else:
                for atom in self._effects[step]:
                    different.pop(atom, None)
            for atom in atoms & different.keys():
                users = self._users[atom]
                index = bisect_right(users, step)
                if index == len(users):
                    if atom in self._goal_atoms:
                        return set()
                elif users[index] not in queued:
                    queued.add(users[index])
                    heappush(queue, users[index])
        end = _Facts(self, different, len(self._steps))
        reached = all(holds(part, end) for part, atoms in self._alternatives if not atoms.isdisjoint(different))
        return gone if reached else set()

    def remove(self, steps: Iterable[int]) -> None:
        """Removes steps from the plan."""
        for step in steps:
            for atom in self._atoms_of(step):
                self._users[atom].remove(step)
            for atom, state in self._effects[step].items():
                self._producers[atom].remove((step, state))

    def _atoms_of(self, step: int) -> frozenset[Atom]:
        return self._needed[step] | self._effects[step].keys()

    def _can_run(self, step: int, different: dict[Atom, bool]) -> bool:
        needed = self._needed[step]
        return needed.isdisjoint(different) or self._steps[step].can_start(_Facts(self, different, step))

    def value(self, atom: Atom, step: int) -> bool:
        """Whether a fact holds in the plan when a step starts."""
        producers = self._producers.get(atom, ())
        index = bisect_left(producers, (step,))
        return producers[index - 1][1] if index else atom in self._init


class _Facts:
    """The facts in a trial when a step starts."""

    def __init__(self, trials: _Trials, different: dict[Atom, bool], step: int) -> None:
        self._trials = trials
        self._different = different
        self._step = step

    def __contains__(self, atom: object) -> bool:
        assert isinstance(atom, Atom)
        known = self._different.get(atom)
        return self._trials.value(atom, self._step) if known is None else known


def _atoms(formula: Formula) -> frozenset[Atom]:
    return frozenset(atom for atom, _ in literals(formula))


def _is_literal(formula: Formula) -> bool:
    return isinstance(formula.part if isinstance(formula, Not) else formula, Atom)
