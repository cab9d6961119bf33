"""Splits a plan into parts that one robot has to execute, for `robot_assignment`."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from skiros2_task.core.formula import Atom
from skiros2_task.core.ground_actions import Facts, GroundAction
from skiros2_task.core.partial_order import GOAL, INIT, CausalLink, PartialOrder, changes_of, ordering_constraints
from skiros2_task.core.task import PlanningTask


@dataclass(frozen=True)
class Target:
    """A fact about the robot that a step needs and that a move brings about, such as its location.

    :param predicate: the predicate's number.
    :param position: the robot's position among the terms.
    """

    predicate: int
    position: int
    terms: tuple[str, ...]


@dataclass
class Part:
    """Steps that one robot has to execute.

    :param steps: their indices in the plan.
    :param targets: the targets of each step.
    :param after: the indices of the parts that must end before this one.
    :param pinned: the part stays with the robot of the plan.
    :param final: the goal needs a fact about the robot that the part brings about.
    """

    steps: list[int] = field(default_factory=list)
    targets: dict[int, list[Target]] = field(default_factory=dict)
    after: set[int] = field(default_factory=set)
    pinned: bool = False
    final: bool = False


#: Actions that change only facts about the robot, by the number of the predicate that they make true and the robot's
#: position in it, with the variable of each term. Their other parameters are functionally determined by the robot.
Moves = Mapping[tuple[int, int], Sequence[tuple[GroundAction, list[int]]]]


def find_moves(actions: Collection[GroundAction], facts: Facts) -> Moves:
    """Returns the moves among actions."""
    found: dict[tuple[int, int], list[tuple[GroundAction, list[int]]]] = {}
    for ground in actions:
        index = {v.name: i for i, v in enumerate(ground.action.variables)}
        for effect in ground.action.effects if ground.is_move else ():
            terms = [index.get(t, -1) for t in effect.atom.terms]
            if effect.state and -1 not in terms and set(ground.essential) <= set(terms):
                key = facts.number(effect.atom.predicate), terms.index(ground.robot)
                found.setdefault(key, []).append((ground, terms))
    return found


def split_plan(
    task: PlanningTask, order: PartialOrder, actions: Mapping[str, GroundAction], moves: Moves, facts: Facts
) -> list[Part]:
    """Returns the parts of a plan. A move belongs to a part only if it matters which robot moves."""
    return _Splitter(task, order, actions, moves, facts).split()


class _Splitter:
    def __init__(
        self, task: PlanningTask, order: PartialOrder, actions: Mapping[str, GroundAction], moves: Moves, facts: Facts
    ) -> None:
        self._task = task
        self._order = order
        self._moves = moves
        self._facts = facts
        self._ground = [actions[step.action] for step in order.steps]
        together = list(zip(order.steps, self._ground, strict=True))
        self._robots = [step.arguments[ground.robot] for step, ground in together]
        #: The robot and its tools, the essential arguments and the arguments determined by the robot's state, by step.
        self._own = [{step.arguments[i] for i in (ground.robot, *ground.tools)} for step, ground in together]
        self._essential = [{step.arguments[i] for i in ground.essential} for step, ground in together]
        self._state = [{step.arguments[i] for i in ground.states} for step, ground in together]

    def split(self) -> list[Part]:
        """See `split_plan`."""
        links = self._order.links
        pinned = {link.producer: link for link in links if self._pins(link)}
        final = {link.producer for link in links if link.consumer == GOAL} & pinned.keys()
        moving = {id(ground) for some in self._moves.values() for ground, _ in some}
        group = {i: i for i, g in enumerate(self._ground) if i in pinned or id(g) not in moving}
        for link in links:
            if link.producer in group and link.consumer in group and self._requires_same_robot(link):
                old, new = group[link.consumer], group[link.producer]
                group = {i: new if g == old else g for i, g in group.items()}
        parts = {g: Part() for g in group.values()}
        for i, g in group.items():
            parts[g].steps.append(i)
            parts[g].pinned |= i in pinned
            parts[g].final |= i in final
        for link in links:
            if link.consumer in group and link.producer not in group:
                self._add_target(link, parts[group[link.consumer]])
        numbers = {g: number for number, g in enumerate(parts)}
        for i, j, atom in ordering_constraints(links, self._changes(group)):
            apart = i in group and j in group and group[i] != group[j]
            if apart and (self._robots[i] != self._robots[j] or not self._is_about_robot(j, atom)):
                parts[group[j]].after.add(numbers[group[i]])
        return list(parts.values())

    def _is_about_robot(self, index: int, atom: Atom) -> bool:
        """Whether a fact is about the robot of a step, or its tools."""
        return not self._own[index].isdisjoint(atom.terms)

    def _pins(self, link: CausalLink) -> bool:
        """Whether a link is about the robot of its producer, and the goal or another robot needs it."""
        i, j = link.producer, link.consumer
        return i != INIT and (j == GOAL or self._robots[i] != self._robots[j]) and self._is_about_robot(i, link.atom)

    def _requires_same_robot(self, link: CausalLink) -> bool:
        """Whether the robot of a link's producer must execute its consumer."""
        i, j, atom = link.producer, link.consumer, link.atom
        if self._robots[i] != self._robots[j] or not self._is_about_robot(j, atom):
            return False
        if not self._state[j].isdisjoint(atom.terms):
            return False
        # A fact that held initially is likely to hold for other robots as well.
        return not self._essential[j].isdisjoint(atom.terms) or (atom in self._task.init) != link.state

    def _add_target(self, link: CausalLink, part: Part) -> None:
        robot, terms = self._robots[link.consumer], link.atom.terms
        if link.state and robot in terms and self._essential[link.consumer].issuperset(t for t in terms if t != robot):
            target = Target(self._facts.number(link.atom.predicate), terms.index(robot), terms)
            if (target.predicate, target.position) in self._moves:
                part.targets.setdefault(link.consumer, []).append(target)

    def _changes(self, steps: Collection[int]) -> dict[Atom, list[tuple[int, bool]]]:
        found: dict[Atom, list[tuple[int, bool]]] = {}
        for i in steps:
            changes = changes_of(self._task, self._order.steps[i])
            for some in (changes.during, changes.effects):
                for atom, state in some.items():
                    found.setdefault(atom, []).append((i, state))
        return found
