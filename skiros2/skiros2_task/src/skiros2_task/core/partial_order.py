"""Plans as partial orders: deorders a sequence of steps.

Two steps stay in order if one produces a fact that the other needs, if one deletes a fact that the other needs or
produces, or if both use the same robot or a device that one of them locks. All other steps may run in any order and at
the same time. The producer of a fact is the step after which it has held continuously, or the initial state
(Kambhampati, Kedar: A unified framework for explanation-based generalization of partially ordered and partially
instantiated plans, Artificial Intelligence 67, 1994; for skills: Rovida, Grossmann, Krueger: Extended behavior trees
for quick definition of flexible robotic tasks, IROS 2017).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.formula import Atom, Formula, conjuncts
from skiros2_task.core.semantics import GroundStep, support
from skiros2_task.core.task import PlanningTask, PlanStep

#: The initial state as a producer, and the goal as a consumer of facts.
INIT, GOAL = -1, -2


@dataclass(frozen=True)
class CausalLink:
    """A fact that one step produces and another one needs. No step between them may change it.

    :param producer: a step's index, or `INIT`.
    :param consumer: a step's index, or `GOAL`.
    :param state: whether the atom is needed true or false.
    """

    producer: int
    consumer: int
    atom: Atom
    state: bool


@dataclass(frozen=True)
class PartialOrder:
    """A partially ordered plan. Every linearisation is a valid plan.

    :param steps: in an executable order.
    :param before: pairs of indices, transitively reduced: the first step must end before the second starts.
    :param links: the causal links of all steps and of the goal.
    """

    steps: tuple[PlanStep, ...]
    before: frozenset[tuple[int, int]]
    links: tuple[CausalLink, ...]

    def predecessors(self) -> list[list[int]]:
        """Returns the indices of each step's direct predecessors, sorted."""
        found: list[list[int]] = [[] for _ in self.steps]
        for first, second in sorted(self.before):
            found[second].append(first)
        return found


def deorder(task: PlanningTask, plan: Sequence[PlanStep]) -> PartialOrder:
    """Returns the partial order of a plan.

    :param plan: a valid plan; see `semantics.validate`.
    :raises WrongValue: the plan is not valid.
    """
    history = _History(task.init)
    steps = [task.ground(step) for step in plan]
    links: list[CausalLink] = []
    for index, step in enumerate(steps):
        links += history.links(step.precondition, index, str(plan[index]))
        history.add(index, step)
    links += history.links(task.goal, GOAL, "the goal")
    pairs = {(first, second) for first, second, _ in ordering_constraints(links, history.changes)}
    pairs.update(_same_robot(step.robot for step in steps))
    return PartialOrder(tuple(plan), frozenset(_reduced(pairs, len(plan))), tuple(links))


#: For each atom the steps that change it, also only while they run, in order, with the new value.
AtomChanges = Mapping[Atom, Sequence[tuple[int, bool]]]


def ordering_constraints(links: Iterable[CausalLink], changes: AtomChanges) -> Iterator[tuple[int, int, Atom]]:
    """Yields the ordered pairs of steps, each with the fact that orders them. Robots are not considered.

    Pairs that follow from others may be missing.
    """
    for link in links:
        if link.consumer == GOAL:
            continue
        if link.producer != INIT:
            yield link.producer, link.consumer, link.atom
        # A step that deletes the fact starts after its consumer.
        for index in _next_with_value(not link.state, changes.get(link.atom, ()), link.consumer):
            yield link.consumer, index, link.atom
    # Steps that give a fact different values stay in order.
    for atom, values in changes.items():
        for index, state in values:
            yield from ((index, other, atom) for other in _next_with_value(not state, values, index))


def _next_with_value(value: bool, changes: Sequence[tuple[int, bool]], after: int) -> Iterator[int]:
    """Yields the steps after a step that give a fact a value, up to the next one that gives it the other value."""
    found = False
    for position in range(bisect_right(changes, after, key=itemgetter(0)), len(changes)):
        index, state = changes[position]
        if state == value:
            found = True
            yield index
        elif found:
            return


class _History:
    """The facts during the execution of a plan, and the step since which each has had its value."""

    def __init__(self, init: frozenset[Atom]) -> None:
        self._init = init
        self._now: dict[Atom, bool] = {}
        self._since: dict[Atom, int] = {}
        self.changes: dict[Atom, list[tuple[int, bool]]] = {}

    def add(self, index: int, step: GroundStep) -> None:
        """Executes the next step."""
        for atom, state in step.during.items():
            self.changes.setdefault(atom, []).append((index, state))
            if atom not in step.effects:  # the value is restored when the step ends
                self._now[atom], self._since[atom] = self._holds(atom), index
        for atom, state in step.effects.items():
            self.changes.setdefault(atom, []).append((index, state))
            if self._holds(atom) != state or atom in step.during:
                self._now[atom], self._since[atom] = state, index

    def _holds(self, atom: Atom) -> bool:
        known = self._now.get(atom)
        return atom in self._init if known is None else known

    def _held_since(self, atom: Atom) -> int:
        return self._since.get(atom, INIT)

    def links(self, formula: Formula, consumer: int, name: str) -> Iterator[CausalLink]:
        """Yields the links of literals that make a formula true now to the steps since which they have held.

        :param consumer: the step that needs the formula, or `GOAL`.
        :param name: of the consumer, for the error.
        :raises WrongValue: the formula is false.
        """
        for part in conjuncts(formula):
            literals = support(part, self._holds, self._held_since)
            if literals is None:
                raise WrongValue(f"the plan does not work: {name}: {part} does not hold")
            yield from (CausalLink(self._held_since(atom), consumer, atom, state) for atom, state in literals)


def _same_robot(robots: Iterable[str]) -> Iterator[tuple[int, int]]:
    """Yields the pairs of consecutive steps of each robot."""
    last: dict[str, int] = {}
    for index, robot in enumerate(robots):
        if robot in last:
            yield last[robot], index
        last[robot] = index


def _reduced(pairs: Iterable[tuple[int, int]], count: int) -> Iterator[tuple[int, int]]:
    """Yields the transitive reduction of pairs, all from a smaller to a greater index."""
    before: list[set[int]] = [set() for _ in range(count)]
    for first, second in pairs:
        before[second].add(first)
    ancestors = [0] * count  # bit sets
    for second in range(count):
        for first in sorted(before[second], reverse=True):
            if not ancestors[second] >> first & 1:
                ancestors[second] |= ancestors[first] | 1 << first
                yield first, second
