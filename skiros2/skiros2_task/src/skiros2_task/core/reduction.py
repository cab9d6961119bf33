"""Removes steps from a plan that it works without.

Action elimination: each step in turn is left out, and with it every later step whose pre-condition then fails; where
the goal still holds at the end, these steps are removed (Nakhost and Müller: Action elimination and plan neighborhood
graph search, ICAPS 2010; Fink and Yang: Formalizing plan justifications, CSCSI 1992, who call a plan from which
nothing can be removed so *greedily justified*). It is repeated until nothing can be removed.

A trial follows only the facts that are different without the removed steps, from each step that needs or changes one
of them to the next.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from heapq import heappop, heappush

from skiros2_task.core.formula import Atom, Formula, Not, conjuncts, holds, literals
from skiros2_task.core.partial_order import changes_of
from skiros2_task.core.task import PlanningTask, PlanStep, precondition_of


def reduced(task: PlanningTask, plan: Sequence[PlanStep]) -> tuple[PlanStep, ...]:
    """The plan without redundant steps, in the same order.

    :param plan: steps that work in this order; see `simulation.flaw`.
    :returns: steps that work, none of which can be removed, alone or with the later steps that need it.
    """
    trials = _Trials(task, plan)
    kept = list(range(len(plan)))
    place = necessary = 0  # the number of steps in a row that have to stay
    while necessary < len(kept):
        place %= len(kept)
        removed = trials.without(kept[place])
        if removed:
            trials.remove(removed)
            kept = [step for step in kept if step not in removed]
            necessary = 0
        else:
            place += 1
            necessary += 1
    return tuple(plan[step] for step in kept)


class _Trials:
    """A plan, and trials of what happens without some of its steps. Steps go by their index in the whole plan."""

    def __init__(self, task: PlanningTask, plan: Sequence[PlanStep]) -> None:
        self._init = task.init
        self._needs = [precondition_of(task, step) for step in plan]
        self._needed = [_atoms(need) for need in self._needs]
        self._made = [changes_of(task, step).made for step in plan]
        #: For each atom the steps that make it true or false, and those that need or change it, in order.
        self._makers: dict[Atom, list[tuple[int, bool]]] = {}
        self._users: dict[Atom, list[int]] = {}
        for step in range(len(plan)):
            for atom in self._concerns(step):
                self._users.setdefault(atom, []).append(step)
            for atom, state in self._made[step].items():
                self._makers.setdefault(atom, []).append((step, state))
        #: What the goal asks for: facts, which must not be different at the end, and formulas with alternatives.
        parts = conjuncts(task.goal)
        self._decisive = {atom for part in parts if _is_literal(part) for atom in _atoms(part)}
        self._alternatives = [(part, _atoms(part)) for part in parts if not _is_literal(part)]

    def without(self, removed: int) -> set[int]:
        """The step and the later ones that have to go with it; empty where the goal does not hold without them."""
        gone: set[int] = set()
        different: dict[Atom, bool] = {}  # the facts that are not as in the plan, as they are
        queue, queued = [removed], {removed}
        while queue:
            step = heappop(queue)
            concerns = self._concerns(step)
            if step == removed or not self._can_run(step, different):
                gone.add(step)
                for atom, state in self._made[step].items():
                    now = different.pop(atom, self._holds(atom, step))
                    if now != state:
                        different[atom] = now
            else:
                for atom in self._made[step]:
                    different.pop(atom, None)
            for atom in concerns & different.keys():
                users = self._users[atom]
                index = bisect_right(users, step)
                if index == len(users):
                    if atom in self._decisive:
                        return set()
                elif users[index] not in queued:
                    queued.add(users[index])
                    heappush(queue, users[index])
        end = _Facts(self, different, len(self._needs))
        reached = all(holds(part, end) for part, atoms in self._alternatives if not atoms.isdisjoint(different))
        return gone if reached else set()

    def remove(self, steps: Iterable[int]) -> None:
        """Takes steps out of the plan."""
        for step in steps:
            for atom in self._concerns(step):
                self._users[atom].remove(step)
            for atom, state in self._made[step].items():
                self._makers[atom].remove((step, state))

    def _concerns(self, step: int) -> frozenset[Atom]:
        return self._needed[step] | self._made[step].keys()

    def _can_run(self, step: int, different: dict[Atom, bool]) -> bool:
        needed = self._needed[step]
        return needed.isdisjoint(different) or holds(self._needs[step], _Facts(self, different, step))

    def _holds(self, atom: Atom, step: int) -> bool:
        """Whether a fact holds in the plan when a step starts."""
        makers = self._makers.get(atom, ())
        index = bisect_left(makers, (step,))
        return makers[index - 1][1] if index else atom in self._init


class _Facts:
    """The facts in a trial when a step starts."""

    def __init__(self, trials: _Trials, different: dict[Atom, bool], step: int) -> None:
        self._trials = trials
        self._different = different
        self._step = step

    def __contains__(self, atom: object) -> bool:
        assert isinstance(atom, Atom)
        known = self._different.get(atom)
        return self._trials._holds(atom, self._step) if known is None else known


def _atoms(formula: Formula) -> frozenset[Atom]:
    return frozenset(atom for atom, _ in literals(formula))


def _is_literal(formula: Formula) -> bool:
    return isinstance(formula.part if isinstance(formula, Not) else formula, Atom)
