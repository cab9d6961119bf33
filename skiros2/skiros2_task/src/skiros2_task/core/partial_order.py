"""Plans as partial orders: of a sequence of steps, only the order that is needed.

Two steps stay in the order of the sequence when one makes what the other needs, when one would spoil what the other
needs or makes, or when both use one resource: the robot, or a device that a step has locked. All others may run in any
order, and at the same time. Which step makes what is read off the sequence: a fact that a step needs comes from the
step after which it held without a break, or from the start (Kambhampati, Kedar: A unified framework for
explanation-based generalization of partially ordered and partially instantiated plans, Artificial Intelligence 67,
1994; for skills: Rovida, Grossmann, Krueger: Extended behavior trees for quick definition of flexible robotic tasks,
IROS 2017).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.formula import And, Atom, Formula, Not, Or, conjuncts
from skiros2_task.core.task import PlanningTask, PlanStep, during_of, effects_of, precondition_of, robot_of

#: Stands for the start as the producer of a fact, and for the goal as its consumer.
INIT, GOAL = -1, -2


@dataclass(frozen=True)
class CausalLink:
    """A fact that one step makes and another needs; between them nothing may spoil it.

    :param producer: the index of the step that makes it, or `INIT`.
    :param consumer: the index of the step that needs it, or `GOAL`.
    :param state: whether the atom has to hold, or must not.
    """

    producer: int
    consumer: int
    atom: Atom
    state: bool


@dataclass(frozen=True)
class PartialOrder:
    """Steps and what is needed of their order. Each order of the steps that respects it is a plan that works.

    :param steps: in an order that works.
    :param before: pairs of indices: the first step has to end before the second starts. What follows from others is
        left out.
    :param links: why the plan works: for each step, and for the goal, where the facts that it needs come from.
    """

    steps: tuple[PlanStep, ...]
    before: frozenset[tuple[int, int]]
    links: tuple[CausalLink, ...]

    def predecessors(self) -> list[list[int]]:
        """For each step the ones that have to end right before it, by index, in order."""
        found: list[list[int]] = [[] for _ in self.steps]
        for first, second in sorted(self.before):
            found[second].append(first)
        return found


def deorder(task: PlanningTask, plan: Sequence[PlanStep]) -> PartialOrder:
    """The partial order of a plan.

    :param plan: steps that work in this order; see `simulation.flaw`.
    :raises WrongValue: they do not.
    """
    history = _History(task.init)
    links: list[CausalLink] = []
    for index, step in enumerate(plan):
        needed = precondition_of(task, step)
        links += (CausalLink(producer, index, *literal) for producer, literal in history.support(needed, str(step)))
        history.add(index, changes_of(task, step))
    links += (CausalLink(producer, GOAL, *literal) for producer, literal in history.support(task.goal, "the goal"))
    pairs = {(first, second) for first, second, _ in reasons(links, history.touched)}
    pairs.update(_same_robot(robot_of(task, step) for step in plan))
    return PartialOrder(tuple(plan), frozenset(_reduced(pairs, len(plan))), tuple(links))


Literal = tuple[Atom, bool]
#: For each atom the steps that change it, in order, with what they make it, if only while they run.
Touched = Mapping[Atom, Sequence[tuple[int, bool]]]


@dataclass(frozen=True)
class Changes:
    """What a step does to the facts.

    :param made: what it makes true or false by its end; what it makes both is true.
    :param during: what it makes true or false while it runs.
    """

    made: Mapping[Atom, bool]
    during: Mapping[Atom, bool]


def changes_of(task: PlanningTask, step: PlanStep) -> Changes:
    """What a step does to the facts."""
    made: dict[Atom, bool] = {}
    for atom, state in effects_of(task, step):
        made[atom] = state or made.get(atom, False)
    return Changes(made, dict(during_of(task, step)))


def reasons(links: Iterable[CausalLink], touched: Touched) -> Iterator[tuple[int, int, Atom]]:
    """Why steps have to stay in order, robots aside: the first, the second, and the fact that it is about.

    What follows from others may be left out.
    """
    for link in links:
        if link.consumer == GOAL:
            continue
        if link.producer != INIT:
            yield link.producer, link.consumer, link.atom
        # What would spoil the fact waits for the one that needs it; the one that makes it, for what spoilt it before.
        for index in _next_to_make(not link.state, touched.get(link.atom, ()), link.consumer):
            yield link.consumer, index, link.atom
    # Steps that make a fact different stay in order: each finds it its own way when it ends.
    for atom, changes in touched.items():
        for index, state in changes:
            yield from ((index, other, atom) for other in _next_to_make(not state, changes, index))


def _next_to_make(wanted: bool, changes: Sequence[tuple[int, bool]], after: int) -> Iterator[int]:
    """The steps after one that are the next to make a fact so, up to one that makes it different again."""
    found = False
    for place in range(bisect_right(changes, after, key=itemgetter(0)), len(changes)):
        index, state = changes[place]
        if state == wanted:
            found = True
            yield index
        elif found:
            return


class _History:
    """The facts while a plan is carried out, and since when each has been as it is."""

    def __init__(self, init: frozenset[Atom]) -> None:
        self._init = init
        self._now: dict[Atom, bool] = {}
        self._since: dict[Atom, int] = {}
        self.touched: dict[Atom, list[tuple[int, bool]]] = {}

    def add(self, index: int, changes: Changes) -> None:
        """Carries out the next step."""
        for atom, state in changes.during.items():
            self.touched.setdefault(atom, []).append((index, state))
            if atom not in changes.made:  # as before, but only from the end of the step on
                self._now[atom], self._since[atom] = self._holds(atom), index
        for atom, state in changes.made.items():
            self.touched.setdefault(atom, []).append((index, state))
            if self._holds(atom) != state or atom in changes.during:
                self._now[atom], self._since[atom] = state, index

    def _holds(self, atom: Atom) -> bool:
        known = self._now.get(atom)
        return atom in self._init if known is None else known

    def support(self, formula: Formula, place: str) -> Iterator[tuple[int, Literal]]:
        """Literals that make a formula true now, each with the step since which it has held.

        :param place: where the formula stands, for the error.
        :raises WrongValue: it is not true.
        """
        for part in conjuncts(formula):
            literals = self._literals(part, True)
            if literals is None:
                raise WrongValue(f"the plan does not work: {place}: {part} does not hold")
            yield from ((self._since.get(atom, INIT), (atom, state)) for atom, state in literals)

    def _literals(self, formula: Formula, wanted: bool) -> list[Literal] | None:
        """Literals that give a formula its wanted value; None when it has the other one."""
        if isinstance(formula, Atom):
            return [(formula, wanted)] if self._holds(formula) == wanted else None
        if isinstance(formula, Not):
            return self._literals(formula.part, not wanted)
        if not isinstance(formula, And | Or):
            raise TypeError(f"{formula} has a quantifier; write it out first")
        parts = [self._literals(part, wanted) for part in formula.parts]
        there = [part for part in parts if part is not None]
        if isinstance(formula, And) == wanted:
            return [literal for part in there for literal in part] if len(there) == len(parts) else None
        # Of alternatives the one that has held longest binds the step least.
        return min(there, key=lambda part: max((self._since.get(a, INIT) for a, _ in part), default=INIT), default=None)


def _same_robot(robots: Iterable[str]) -> Iterator[tuple[int, int]]:
    """A robot does one step after the other."""
    last: dict[str, int] = {}
    for index, robot in enumerate(robots):
        if robot in last:
            yield last[robot], index
        last[robot] = index


def _reduced(pairs: Iterable[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
    """The pairs, all from a smaller to a greater index, without those that follow from others."""
    before: list[set[int]] = [set() for _ in range(count)]
    for first, second in pairs:
        before[second].add(first)
    above = [0] * count  # bits: all steps before each
    for second in range(count):
        for first in sorted(before[second], reverse=True):
            if not above[second] >> first & 1:
                above[second] |= above[first] | 1 << first
                yield first, second
